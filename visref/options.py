"""Options of whatever is found by name: `NAME:option=value,…`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from visref.errors import InputError
from visref.numerals import decimal_number, whole_number
from visref.wording import did_you_mean

OptionValue = bool | int | float | str


@dataclass(frozen=True)
class Option:
    """One option of a culler, an engine or a scene generator.

    Its type is its default's; `choices`, where given, are all it may be.
    """

    default: OptionValue
    help: str
    choices: tuple[str | int, ...] = ()


def read_options(spec: str, known: Mapping[str, Option], text: str) -> dict[str, OptionValue]:
    """The options `text`, `option=value,…`, that `spec` ends in; those not given are left out.

    Raises InputError for an unknown option and for a value that the option cannot be.
    """
    values: dict[str, OptionValue] = {}
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if not equals:
            raise InputError(f"'{part}' in '{spec}' is not option=value", fix="write option=value")
        if name not in known:
            raise InputError(
                f"'{spec}' has no option '{name}'",
                fix=did_you_mean(name, known),
            )
        if name in values:
            raise InputError(f"option '{name}' comes twice in '{spec}'", fix="keep one")
        values[name] = _value(spec, name, value, known[name])
    return values


_TRUTHS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


_READ: dict[type, Callable[[str], OptionValue]] = {
    bool: lambda text: _TRUTHS[text.lower()],
    int: whole_number,
    float: decimal_number,
    str: str,
}


def _value(spec: str, name: str, text: str, option: Option) -> OptionValue:
    kind = type(option.default)
    value: OptionValue
    try:
        value = _READ[kind](text)
    except (KeyError, ValueError) as error:
        raise InputError(
            f"'{name}={text}' in '{spec}' is not a {kind.__name__}",
            fix=f"the default is {option.default}",
        ) from error
    if option.choices and value not in option.choices:
        allowed = ", ".join(map(str, option.choices))
        raise InputError(f"'{name}={text}' in '{spec}' is not a choice", fix=f"give {allowed}")
    return value
