"""The `degense` command."""

from __future__ import annotations

import importlib
import signal
import sys
from collections.abc import Sequence

from degense.app.cli.parser import build_parser
from degense.engine.errors import OUT_OF_MEMORY, Cancelled, DegenseError, is_out_of_memory

USER_ERROR, INTERRUPTED = 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; the exit status: 0 done, 1 diagnostics or jobs of a batch failed, 2 an error in words, 130 interrupted."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser, commands = build_parser()
    if not arguments or (not arguments[0].startswith("-") and arguments[0] not in commands):
        arguments = ["open", *arguments]
    try:
        options = parser.parse_args(arguments)
        module, function = options.run.split(":")
        return getattr(importlib.import_module(module), function)(options) or 0
    except DegenseError as error:
        print(f"degense: {error}", file=sys.stderr)
        return USER_ERROR
    except (MemoryError, RuntimeError) as error:
        if not is_out_of_memory(error):
            raise
        print(f"degense: {OUT_OF_MEMORY}", file=sys.stderr)
        return USER_ERROR
    except (KeyboardInterrupt, Cancelled):
        print("degense: stopped.", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has gone (`degense eval … | head`): leave quietly, and keep Python from complaining at exit.
        sys.stdout = None
        return 128 + signal.SIGPIPE
