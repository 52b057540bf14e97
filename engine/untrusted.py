"""Reading files of unknown origin: a regular file of bounded size; JSON and YAML of bounded nesting, JSON of finite numbers."""

from __future__ import annotations

import json
import math
import os
import stat
from pathlib import Path
from typing import Any, NoReturn

from degense.engine.progress import check_reading

#: How deep lists and objects may lie in each other: nothing that we read needs more than ten.
DEEPEST = 64
#: Whole numbers beyond it fit no count, index or size.
GREATEST = 1 << 63


def check_regular(path: Path, most: int) -> int:
    """The bytes of a file, which is not opened: a pipe would block. ValueError for what is no regular file, or larger than `most` bytes."""
    check_reading()
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise ValueError("it is not a regular file")
    if found.st_size > most:
        raise ValueError(f"it is larger than {most:,} bytes, the most that is read")
    return found.st_size


def read_bytes(path: Path, most: int) -> bytes:
    """A regular file of at most `most` bytes. OSError when it cannot be read, ValueError when it is none or larger."""
    size = check_regular(path, most)
    with open(path, "rb", opener=_without_waiting) as file:
        data = file.read(size + 1)  # not of `most`: Python takes the memory that is asked for
    if len(data) > size:
        raise ValueError("it grows while it is read")
    return data


def read_json(path: Path, most: int, greatest: int = GREATEST) -> Any:
    """What a JSON file of at most `most` bytes holds, as `parse_json`. OSError and ValueError as `read_bytes`."""
    return parse_json(read_bytes(path, most), greatest)


def parse_json(text: str | bytes, greatest: int = GREATEST) -> Any:
    """The values of a JSON text in UTF-8.

    ValueError when it is none, has a number that is not finite or a whole one beyond `greatest`, or is nested more than `DEEPEST` deep.
    """

    def whole(digits: str) -> int:
        if len(digits) > 40 or abs(number := int(digits)) > greatest:
            raise ValueError(f"{digits[:40]} is too large a number")
        return number

    try:
        if isinstance(text, bytes):
            text = text.decode("utf-8")
        value = json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=whole)
    except RecursionError as error:
        raise ValueError(f"it is nested more than {DEEPEST} deep") from error
    level = [value]
    for _ in range(DEEPEST + 1):
        inside = (outer.values() if isinstance(outer, dict) else outer for outer in level if isinstance(outer, (dict, list)))
        level = [inner for values in inside for inner in values if isinstance(inner, (dict, list))]
        if not level:
            return value
    raise ValueError(f"it is nested more than {DEEPEST} deep")


def check_yaml(text: str) -> None:
    """ValueError when a YAML text is damaged, or nested more than `DEEPEST` levels, which crashes libyaml's loader from some tens of
    thousands on."""
    import yaml

    deep = 0
    try:
        for event in yaml.parse(text, _yaml_loader()):
            deep += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if deep > DEEPEST:
                raise ValueError(f"nested more than {DEEPEST} levels")
    except yaml.YAMLError as error:
        raise ValueError("no valid YAML") from error


def parse_yaml(text: str) -> Any:
    """Strings, lists and mappings of a YAML text, nothing else. ValueError as of `check_yaml`, and for keys that are lists or mappings."""
    import yaml

    check_yaml(text)
    reading = _yaml_loader()(text)
    try:
        return reading.get_single_data()
    except yaml.YAMLError as error:
        raise ValueError("no valid YAML") from error
    finally:
        reading.dispose()


def _yaml_loader() -> Any:
    """libyaml's, where PyYAML has it: its own takes ten times as long."""
    import yaml

    return getattr(yaml, "CBaseLoader", yaml.BaseLoader)


def _without_waiting(path: str, flags: int) -> int:
    """Opens a file; one that became a pipe meanwhile is not waited for."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is no number")
    return number
