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


def test_simulate_and_reconcile_are_functions_beside_their_packages(bundle_folder, tmp_path):
    from st_codegen.reconcile import run  # noqa: F401 - imported first, it must not take the function's name

    with pytest.raises(InputError, match=r"rig\.toml"):
        st_codegen.simulate(st_codegen.load(bundle_folder), tmp_path / "rig.toml")
    with pytest.raises(InputError, match=r"rig\.toml"):
        st_codegen.reconcile(tmp_path / "rig.toml", tmp_path)
