"""`degense cache` and `degense doctor`."""

from __future__ import annotations

import argparse

from degense.engine.errors import DegenseError


def cache(options: argparse.Namespace) -> None:
    from degense.engine.semantics.teachers import target_cache as store

    if options.limit is not None:
        if not 0 <= options.limit <= 1e6:
            raise DegenseError(f"a limit of {options.limit:g} GB makes no sense; choose 0 to 1000000")
        store.set_limit(round(options.limit * 2**30))
    if options.clear:
        gone = store.clear_cache()
        print(f"Removed the answers to {gone.entries} askings, {gone.bytes / 2**20:,.0f} MB.")
    use = store.cache_use()
    print(f"{store.cache_folder()}: answers to {use.entries} askings, {use.bytes / 2**20:,.0f} MB of at most {use.limit / 2**30:g} GB")


def doctor(options: argparse.Namespace) -> int:
    from degense.app.diagnostics import report

    text, ok = report()
    print(text)
    return 0 if ok else 1
