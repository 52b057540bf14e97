"""Plans as TOML files, which come from elsewhere: what is not understood is refused in a sentence, and none says where to write."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from degense.app.batch.plan import MOST_JOBS, BatchJob, JobOptions, check_name, name_of, numbered, with_own_names
from degense.engine.errors import DegenseError
from degense.engine.untrusted import read_bytes

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MOST_BYTES = 4 << 20
OPTIONS = {item.name for item in fields(JobOptions)}
HINTS = get_type_hints(JobOptions)
#: What kinds of values are called.
KINDS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false"}


def read_plan(path: Path) -> list[BatchJob]:
    """The jobs of a plan: every clip with every variant; paths are meant as seen from the folder of the file.

    DegenseError in one sentence for a file that is no plan.
    """
    try:
        data = read_bytes(path, MOST_BYTES)
    except OSError as error:
        raise DegenseError(f"{path} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise DegenseError(f"{path} is no plan: {error}.") from error
    try:
        plan = tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:  # TOML and its encoding are ValueErrors
        raise DegenseError(f"{path} is not TOML ({error}); `degense batch --help` shows a plan.") from error
    return jobs_of(plan, path.resolve().parent, path.name)


def jobs_of(plan: Mapping[str, Any], base: Path, where: str) -> list[BatchJob]:
    """The jobs that a parsed plan names; `where` is what sentences call it."""
    _refuse_unknown(plan, {*OPTIONS, "clips", "clip", "variant"}, where)
    common = _with(JobOptions(), plan, where)
    patterns, tables = plan.get("clips", []), plan.get("clip", [])
    if not isinstance(patterns, list) or not all(isinstance(entry, str) for entry in patterns):
        raise DegenseError(f'{where}: clips is a list of texts, such as ["patients/*"]; further settings of one clip go into [[clip]].')
    if not isinstance(tables, list) or not all(isinstance(entry, dict) for entry in tables):
        raise DegenseError(f"{where}: a clip of its own is written [[clip]], with path = and what differs from the others.")
    clips = [(path, "", common) for pattern in patterns for path in found(pattern, base)]
    for entry in tables:
        name, path = entry.get("name", ""), entry.get("path")
        if not isinstance(path, str) or not path or not isinstance(name, str):
            raise DegenseError(f"{where}: a [[clip]] needs path = and takes a name =, both texts.")
        _refuse_unknown(entry, {*OPTIONS, "path", "name"}, f"{where}, [[clip]] {path}")
        if name:
            check_name(name)
        clips.append((Path(path), name, _with(common, entry, f"{where}, [[clip]] {path}")))
    variants = _variants(plan.get("variant", {}), where)
    if len(clips) * len(variants) > MOST_JOBS:
        raise DegenseError(f"{where}: {len(clips):,} clips with {len(variants):,} variants are more than {MOST_JOBS:,} jobs.")
    jobs = []
    for number, (path, name, options) in enumerate(clips, 1):
        for variant, table in variants.items():
            chosen = _with(options, table, f"{where}, [variant.{variant}]")
            shown = numbered(number) if chosen.anonymise else path
            own = "-".join(filter(None, [name, variant])) if name else name_of(shown, variant)
            jobs.append(chosen.job(path, own, base))
    return with_own_names(jobs)


def found(pattern: str, base: Path) -> list[Path]:
    """The clips that a path names: itself if it is there, else `*` and `?` stand for anything within a folder, and `[` for itself.

    DegenseError when a pattern finds nothing.
    """
    if not any(letter in pattern for letter in "*?"):
        return [Path(pattern)]
    start = Path(Path(pattern).anchor)
    root = start if start.parts else base
    try:
        if (base / pattern).exists():
            return [Path(pattern)]
        if "**" in pattern:
            raise DegenseError(f"{pattern!r} looks through all folders; * stands for names within one folder.")
        paths = sorted(root.glob(str(Path(pattern).relative_to(start)).replace("[", "[[]")))[: MOST_JOBS + 1]
    except (ValueError, OSError) as error:
        raise DegenseError(f"{pattern!r} cannot be looked for: {error}.") from error
    clips = [path for path in paths if not path.name.startswith(".")]
    if not clips:
        raise DegenseError(f"{pattern!r} finds no clips in {root}.")
    return clips


def nearest(name: str, known: Collection[str]) -> str:
    """What a wrong name may have meant, as the end of a sentence."""
    close = get_close_matches(name, sorted(known), 1, 0.5)
    return f"did you mean {close[0]!r}?" if close else f"there are {', '.join(sorted(known))}."


def _variants(tables: Any, where: str) -> dict[str, Mapping[str, Any]]:
    if not tables:
        return {"": {}}
    if not isinstance(tables, dict) or not all(isinstance(table, dict) for table in tables.values()):
        raise DegenseError(f"{where}: variants are written [variant.NAME], with what differs in each.")
    for name, table in tables.items():
        check_name(name)
        if len(name) > 39:
            raise DegenseError(f"{where}: the name of the variant {name[:40]!r} is longer than 39 letters.")
        _refuse_unknown(table, OPTIONS, f"{where}, [variant.{name}]")
    return tables


def _refuse_unknown(table: Mapping[str, Any], known: Collection[str], where: str) -> None:
    for name in table:
        if name not in known:
            raise DegenseError(f"{where}: there is no setting {name!r}; {nearest(name, known)}")


def _with(options: JobOptions, table: Mapping[str, Any], where: str) -> JobOptions:
    """The options with those of a table; further settings of the training are added to those there are."""
    values: dict[str, Any] = {}
    for name in OPTIONS & set(table):
        values[name] = _settings(table[name], where) if name == "settings" else _value(name, table[name], where)
    if "settings" in values:
        values["settings"] = tuple({**dict(options.settings), **values["settings"]}.items())
    return replace(options, **values)


def _settings(table: Any, where: str) -> dict[str, str]:
    from degense.app.features.train.job import NAMED, parse_settings
    from degense.engine.training import TrainConfig

    if not isinstance(table, dict):
        raise DegenseError(f"{where}: settings is a table, such as settings = {{ flow = 7.0 }}.")
    known = {item.name for item in fields(TrainConfig)} - set(NAMED)
    _refuse_unknown(table, known, f"{where}, settings")
    try:
        said = {name: json.dumps(value) if not isinstance(value, str) else value for name, value in table.items()}
    except TypeError as error:
        raise DegenseError(f"{where}: a setting is a number, a text, true or false, or a list of numbers.") from error
    parse_settings(tuple(said.items()))
    return said


def _value(name: str, value: Any, where: str) -> Any:
    """A value of the kind that an option has. DegenseError otherwise."""
    hint = HINTS[name]
    if get_origin(hint) is tuple:
        if not isinstance(value, list) or not all(isinstance(entry, str) for entry in value):
            raise DegenseError(f'{where}: {name} is a list of texts, such as ["liver"].')
        return tuple(value)
    kinds = [kind for kind in get_args(hint) if kind is not NoneType] if get_origin(hint) is UnionType else [hint]
    [kind] = kinds
    fits = type(value) is kind or (kind is float and type(value) is int)
    if not fits or (isinstance(value, str) and len(value) > 4096) or (kind is int and not 0 <= value < 1 << 31):
        raise DegenseError(f"{where}: {name} is {KINDS[kind]}, not {str(value)[:40]!r}.")
    return value
