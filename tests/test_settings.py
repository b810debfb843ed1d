"""Settings: defaults, strictness, and one clear line for each mistake."""

from typing import Any

import pytest
from mesh_motion_numerics.method import KEYS, Method
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.limits import default_limits

from mesh_motion_server.settings import DURABILITY_LEVELS, MethodSettings, ServerSettings, check_durability


def test_the_defaults_are_those_of_the_numerics() -> None:
    assert MethodSettings().to_method() == Method()
    assert list(MethodSettings.model_fields) == list(Method.__dataclass_fields__)


@pytest.mark.parametrize(("key", "value"), [(name, value) for name, key in KEYS.items() for value in key.choices])
def test_every_choice_of_the_numerics_is_accepted_with_what_it_needs(key: str, value: str) -> None:
    needed = {other: allowed[0] for other, allowed in KEYS[key].needs.get(value, {}).items()}
    assert getattr(MethodSettings.from_mapping({key: value, **needed}).to_method(), key) == value


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("support_radius", -1.0, "greater than 0"),
        ("support_radius", float("nan"), "a finite number"),
        ("support_radius", "0.5", "a valid number"),
        ("quality_threshold", 1.5, "to 1"),
        ("max_enrichment_points", -1, "from 0"),
        ("refuse_below_threshold", 1, "a valid boolean"),
        ("basis", 3, "a valid string"),
        ("basis", "qb", "gauss (not qb: its interpolation matrix is singular), got 'qb'"),
        ("displacement", "total", "one of relative, absolute, reanchored"),
        ("quality_metric", "aspect", "one of relative-size-skew"),
    ],
)
def test_a_wrong_value_is_named_with_its_key_and_what_was_expected(key: str, value: Any, says: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        MethodSettings.from_mapping({key: value})
    error = caught.value
    assert error.code == "INVALID_ARGUMENT.SETTINGS"
    assert f"setting {key!r}: expected" in error.message
    assert says in error.message
    assert repr(value) in error.message
    assert "\n" not in str(error)
    assert error.details == {"setting": key, "value": repr(value)}


def test_settings_that_cannot_be_combined_are_refused_with_both_names() -> None:
    with pytest.raises(InvalidInput, match=r"reduction = 'greedy': expected basis .*, got 'tps'") as caught:
        MethodSettings.from_mapping({"reduction": "greedy", "basis": "tps"})
    assert (caught.value.code, caught.value.details) == ("INVALID_ARGUMENT.SETTINGS", {"setting": "reduction"})


def test_an_unknown_key_is_named_and_the_known_ones_are_listed() -> None:
    with pytest.raises(InvalidInput, match=r"unknown setting 'radius'; known are basis, support_radius"):
        MethodSettings.from_mapping({"radius": 0.5})
    with pytest.raises(InvalidInput, match=r"expected one of none, .*, got 'optimized' \(did you mean 'optimised'\?\)"):
        MethodSettings.from_mapping({"correction": "optimized"})


@pytest.mark.parametrize("key", [1, b"basis"])
def test_a_key_that_is_no_text_is_refused(key: Any) -> None:
    with pytest.raises(InvalidInput):
        MethodSettings.from_mapping({key: 2})


def test_an_integer_is_a_length_too() -> None:
    assert MethodSettings.from_mapping({"support_radius": 2}).support_radius == 2.0


def test_settings_do_not_change() -> None:
    settings = MethodSettings()
    with pytest.raises(ValueError, match="frozen"):
        settings.basis = "gauss"  # type: ignore[misc]


def test_the_limits_announced_are_the_protocols() -> None:
    limits = ServerSettings().limits()
    assert limits == {name: default_limits()[name] for name in limits}


@pytest.mark.parametrize(
    "values",
    [
        {"max_sessions": 0},
        {"port": 1},
        {"lease_seconds": -1.0},
        {"max_partitions": 257},
        {"threads": 1.0},
        {"threads": -1},
        {"threads": 10**20},
        {"data_ports": "0-9"},
        {"data_ports": "7504-7441"},
        {"data_ports": "65535-65536"},
        {"data_ports": "7441"},
    ],
)
def test_server_settings_are_as_strict(values: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput):
        ServerSettings.from_mapping(values)


@pytest.mark.parametrize("key", ["state_folder", "keys_folder"])
def test_a_folder_whose_name_is_not_in_utf_8_is_refused(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The server would start, and end at the first OPEN."""
    with pytest.raises(InvalidInput, match=f"setting '{key}': expected a path in UTF-8"):
        ServerSettings.from_mapping({key: "/var/a\udc80b"})
    monkeypatch.setenv("HOME", "/home/\udc80")
    with pytest.raises(InvalidInput, match="expected a path in UTF-8"):
        ServerSettings.from_mapping({key: "~/sessions"})
    monkeypatch.undo()
    assert ServerSettings.from_mapping({key: "/var/ü b\n"})


def test_durability() -> None:
    assert check_durability("") == DURABILITY_LEVELS[0] == check_durability("full") == "full"
    with pytest.raises(InvalidInput, match="offered are full, replay, relaxed"):
        check_durability("FULL")


def test_a_server_offers_the_levels_that_its_settings_name() -> None:
    offered = ServerSettings.from_mapping({"durability": ["relaxed", "full"]}).durability
    assert (check_durability("", offered), check_durability("full", offered)) == ("relaxed", "full")
    with pytest.raises(InvalidInput, match="'replay' is not offered; offered are relaxed, full"):
        check_durability("replay", offered)
    for wrong in ([], ["none"], ["full", "full"], "full"):
        with pytest.raises(InvalidInput, match="durability"):
            ServerSettings.from_mapping({"durability": wrong})


def test_the_time_to_drain_is_announced() -> None:
    assert ServerSettings(drain_seconds=2.5).limits()["drain_ms"] == 2500
