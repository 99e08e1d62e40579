"""The public functions of the package, called as the documentation calls them."""

import pytest

import st_codegen
from st_codegen.errors import InputError


def test_models_are_loaded_compiled_verified_and_compared(lone_folder, tmp_path):
    bundle = st_codegen.load(str(lone_folder))
    generated = st_codegen.generate(bundle, "twincat", str(tmp_path / "one"))
    assert "POUs/FB_Te.TcPOU" in generated.files
    st_codegen.generate(bundle, "twincat", str(tmp_path / "two"))
    assert st_codegen.verify(bundle, str(tmp_path / "one"), rows=100).passed
    assert st_codegen.prove(bundle, str(tmp_path / "one")).proved
    assert not st_codegen.diff(str(tmp_path / "one"), str(tmp_path / "two"), rows=10).changed


def test_every_public_name_is_there():
    found = {name: getattr(st_codegen, name) for name in st_codegen.__all__}
    assert all(value is not None for value in found.values())
    assert {type(found[name]).__name__ for name in ("diff", "generate", "reconcile")} == {"function"}
    with pytest.raises(st_codegen.InputError):
        st_codegen.load("none")


def test_the_layout_of_the_trees_is_an_argument(lone_folder, tmp_path):
    options = st_codegen.Options(st_codegen.Layout.TREES)
    made = st_codegen.generate(str(lone_folder), "iec", str(tmp_path), options=options)
    assert [layout for _, layout, _, _ in made.models()] == ["as trained"]


def test_simulate_and_reconcile_are_functions_beside_their_packages(bundle_folder, tmp_path):
    from st_codegen.reconcile import run  # noqa: F401 - imported first, it must not take the function's name

    with pytest.raises(InputError, match=r"rig\.toml"):
        st_codegen.simulate(st_codegen.load(bundle_folder), tmp_path / "rig.toml")
    with pytest.raises(InputError, match=r"rig\.toml"):
        st_codegen.reconcile(tmp_path / "rig.toml", tmp_path)
