"""The public functions of the package, called as the documentation calls them."""

import st_codegen


def test_models_are_loaded_compiled_verified_and_compared(lone_folder, tmp_path):
    bundle = st_codegen.load(str(lone_folder))
    generated = st_codegen.generate(bundle, "twincat", str(tmp_path / "one"))
    assert "POUs/FB_Te.TcPOU" in generated.files
    st_codegen.generate(bundle, "twincat", str(tmp_path / "two"))
    assert st_codegen.verify(bundle, str(tmp_path / "one"), rows=100).passed
    assert not st_codegen.diff(str(tmp_path / "one"), str(tmp_path / "two"), rows=10).changed
