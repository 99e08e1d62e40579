"""docs/effects.md says what the classes of the effects hold: keys, bounds, units' sizes, which keys are required."""

import re
from pathlib import Path

import pytest

from st_codegen.rig.effects import catalogue

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"
SECTION = re.compile(r"^### (?P<names>`\w+`(?:, `\w+`)*)\n(?P<text>.*?)(?=^##|\Z)", re.M | re.S)
BOUNDS = re.compile(r"(\S+) \.\. (\S+)")


def documented():
    """Effect -> key -> (bounds as text, whether it is required)."""
    found = {}
    for section in SECTION.finditer(PAGE.read_text(encoding="utf-8")):
        keys = {}
        column = None
        for line in section["text"].splitlines():
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if line.startswith("| key |"):
                column = cells.index("bounds")
            elif line.startswith("| `") and column is not None:
                for entry in re.finditer(r"`(\w+)`( \(required\))?", cells[0]):
                    keys[entry[1]] = (cells[column], bool(entry[2]))
        for name in re.findall(r"\w+", section["names"]):
            found[name] = keys
    return found


def test_every_effect_has_a_section_and_no_section_is_left_over():
    assert set(documented()) == set(catalogue())


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_keys_and_bounds_are_those_of_the_class(name):
    effect, page = catalogue()[name], documented()[name]
    assert sorted(page) == sorted(effect.known_keys())
    wanted = {scalar.key: (scalar.lower, scalar.upper, scalar.default is None) for scalar in effect.scalars}
    for phasor in effect.phasors:
        wanted[phasor.key] = (0.0, phasor.upper, phasor.required)
        if phasor.own_flanks:
            wanted[phasor.keys(True)[0]] = (0.0, phasor.upper, False)
    for key, (low, high, required) in wanted.items():
        text, is_required = page[key]
        assert tuple(map(float, BOUNDS.fullmatch(text).groups())) == (low, high), key
        assert is_required == required, key
    if effect.orders_key is not None:
        assert page[effect.orders_key] == ("whole, list" if effect.orders_key == "orders" else "whole", True)


def made(name, changes):
    effect = catalogue()[name]
    from st_codegen.rig.effects import Constants

    values = {scalar.key: scalar.upper for scalar in effect.scalars}
    if effect.orders_key:
        allowed = effect.allowed_orders(Constants())
        order = allowed[0] if allowed else 40
        values[effect.orders_key] = [order] if effect.orders_key == "orders" else order
    for phasor in effect.phasors:
        values[phasor.key] = [phasor.upper] if effect.orders_key == "orders" else phasor.upper
    return effect(values | changes, Constants())


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(catalogue()))
def test_values_at_a_bound_are_taken_and_those_beyond_refused(name):
    from st_codegen.errors import InputError

    effect = catalogue()[name]
    made(name, {})
    for scalar in effect.scalars:
        made(name, {scalar.key: scalar.lower})
        beyond = 1e-9 * max(abs(scalar.lower), abs(scalar.upper))
        for value in (scalar.lower - beyond, scalar.upper + beyond, float("nan"), True, "1", None, [1.0]):
            if value is None and scalar.default is not None:
                continue  # None is no TOML: the key is left out
            with pytest.raises(InputError, match=scalar.key):
                made(name, {scalar.key: value})
