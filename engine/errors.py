"""Errors that are meant to be read by the person at the screen."""


class DegenseError(Exception):
    """What is wrong, where, and what to do, in one sentence.

    The command line prints it and exits with status 2; the window shows it in a dialog. Anything else that is raised is a defect.
    """


class ClipError(DegenseError):
    """A clip on disk cannot be used."""


class RunError(DegenseError):
    """A run folder cannot be used."""


class PromptError(DegenseError):
    """A prompt cannot be answered."""


class Cancelled(Exception):
    """The user asked a long job to stop. Raised by a `Progress` callback, never shown as an error."""
