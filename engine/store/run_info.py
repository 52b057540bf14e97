"""What `run.json` must say before anything of it is used."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

from degense.engine.errors import RunError
from degense.engine.field import FieldConfig

MAX_CLASSES, MAX_TEXT, MAX_SIDE = 255, 4096, 1 << 20
LEAST = {"resolution": 2, "time_resolution": 1}  # of a field: a look-up is between two values of a plane, and at a time


def is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= MAX_TEXT and "\0" not in value


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _texts(value: Any) -> bool:
    return isinstance(value, list) and len(value) <= MAX_CLASSES and all(map(is_text, value))


def _named_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(map(is_text, value.values()))


def _positive(value: Any) -> bool:
    return is_number(value) and value > 0


def _object(**kinds: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """A JSON object with at least these values."""
    return lambda value: isinstance(value, dict) and all(name in value and fits(value[name]) for name, fits in kinds.items())


def _teacher(value: Any) -> bool:
    return isinstance(value, dict) and (value.get("name") is None or is_text(value["name"])) and is_text(value.get("provenance", ""))


#: What is used of the file, and whether a value can be it. The first ones must be there.
NEEDED: dict[str, Callable[[Any], bool]] = {
    "config": _object(preset=is_text, routing=is_text),
    "field": lambda value: isinstance(value, dict),
    "cameras": lambda value: isinstance(value, dict),
    "clip": _object(path=is_text, fingerprint=is_text),
    "unit": _positive,
    "state": is_text,
    "classes": _texts,
    "unit_name": is_text,
    "reference_frame": is_count,
    "fps": lambda value: is_number(value) and 0 < value < 1e6,
}
KINDS = {
    **NEEDED,
    "teacher": _teacher,
    "encoder": lambda value: value is None or is_text(value),
    "provenance": _named_texts,
    "train_seconds": lambda value: is_number(value) and value >= 0,
    "gaussians": is_count,
    "iteration": is_count,
    "rollbacks": is_count,
    "moving": lambda value: value is None or is_number(value),
    "confidence": lambda value: value is None or isinstance(value, dict),
}


def check_info(info: dict[str, Any], path: Path) -> None:
    """RunError when something that is used is missing or cannot be what it is for."""
    if missing := sorted(set(NEEDED) - set(info)):
        raise RunError(f"{path} lacks {', '.join(missing)}; the file is damaged")
    if wrong := [name for name, fits in KINDS.items() if name in info and not fits(info[name])]:
        raise RunError(f"{path}: {wrong[0]} cannot be {str(info[wrong[0]])[:80]!r}; the file is damaged")
    check_field(info["field"], path)


def check_field(field: dict[str, Any], path: Path) -> None:
    """RunError unless these are settings of a field, of sizes that a field may have."""
    hints = get_type_hints(FieldConfig)
    for name, value in field.items():
        kind = hints.get(name)
        if kind is int:
            fits = is_count(value) and LEAST.get(name, 0) <= value <= MAX_SIDE
        elif kind is bool:
            fits = isinstance(value, bool)
        elif kind == tuple[int, ...]:
            fits = isinstance(value, list) and 1 <= len(value) <= 16 and all(is_count(level) and 1 <= level <= MAX_SIDE for level in value)
        else:
            fits = kind is not None and value in get_args(kind)
        if not fits:
            raise RunError(f"{path}: the field's {name[:80]!r} cannot be {str(value)[:80]!r}; the file is damaged, or of a newer version")
    if "levels" not in field:
        raise RunError(f"{path} names no levels of its field; the file is damaged")


def plane_numbers(config: FieldConfig) -> int:
    """How many numbers the planes of a field hold."""
    sides = [config.resolution * level for level in config.levels]
    return 3 * config.channels * sum(side * (side + config.time_resolution) for side in sides)
