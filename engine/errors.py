"""Errors that are meant to be read by the person at the screen."""

#: Letters of an error that are shown: what a hostile file says of itself may be endless.
LONGEST = 600


class DegenseError(Exception):
    """What is wrong, where, and what to do, in one sentence: a line of at most `LONGEST` letters, without its middle where it is longer.

    The command line prints it and exits with status 2; the window shows it in a dialog. Anything else that is raised is a defect.
    """

    def __str__(self) -> str:
        line = "".join(letter if letter.isprintable() else " " for letter in super().__str__())
        return line if len(line) <= LONGEST else f"{line[: LONGEST // 2 - 2]} … {line[1 - LONGEST // 2 :]}"


class ClipError(DegenseError):
    """A clip on disk cannot be used."""


class RunError(DegenseError):
    """A run folder cannot be used."""


class PromptError(DegenseError):
    """A prompt cannot be answered."""


class Cancelled(Exception):
    """The user asked a long job to stop. Raised by a `Progress` callback, never shown as an error."""


#: What to do when memory is not enough, in one sentence.
OUT_OF_MEMORY = (
    "The memory of the GPU or of this computer is not enough: close other programs, lower --max-gaussians, take --preset quick, "
    "or compute with --device cpu."
)


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an exception says that memory is not enough, on the GPU (torch's, told by its name: torch need not be there) or the CPU."""
    return isinstance(error, MemoryError) or type(error).__name__ == "OutOfMemoryError"


def what_is_wrong(error: BaseException) -> str:
    """Why a file could not be read, in a line, without the words of Python for parts that do not fit each other."""
    if isinstance(error, KeyError):
        return f"{error} is missing"
    said = str(error).strip().partition("\n")[0]
    return said if said and isinstance(error, (ValueError, OSError, ArithmeticError, DegenseError)) else "its parts do not fit each other"
