"""The reader of TwinCAT's model files: what the vendor's tools write, and whatever else a file may hold."""

import random
import re
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.beckhoff_ml.model import read_model
from st_codegen.cli.main import main
from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.walkers.files import load_model
from tests.beckhoff_ml.test_target import MODELS, only_file
from tests.examples import examples

TREES = only_file(MODELS["scaled trees"])
NETWORK = only_file(MODELS["scaled network"])
SVM = only_file(MODELS["scaled svm"])
FILES = {"trees": TREES, "network": NETWORK, "svm": SVM}


def read(text):
    return read_model(text.encode() if isinstance(text, str) else text, "m.xml", "m")


def once(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


def attribute(text, name, value):
    """The text with another value of the first attribute of a name."""
    changed = re.sub(rf'{name}="[^"]*"', f'{name}="{value}"', text, count=1)
    assert changed != text
    return changed


def without(text, *tags):
    """The text without an element of each tag."""
    for tag in tags:
        text, count = re.subn(rf"\s*<{tag}\b[^>]*?(/>|>.*?</{tag}>)", "", text, count=1, flags=re.S)
        assert count
    return text


CASES = [
    ("", "not well-formed XML"),
    (TREES[:300], "not well-formed XML"),
    (b"\xff\xfe<\x00", "not well-formed XML"),
    ("<project/>", "the root element is 'project', not 'MLlib_XML_File'"),
    ("<MLlib_XML_File/>", "<MLlib_XML_File>: no element <MachineLearningModel>"),
    (attribute(TREES, "modelName", "kmeans"), "the model 'kmeans' is not read; known are tree_ensemble"),
    ('<!DOCTYPE x [<!ENTITY a "1">]>' + TREES.partition("?>")[2], "a document type or an entity is not allowed"),
    (without(TREES, "Configuration"), "no element <Configuration>"),
    (without(TREES, "SplitVars"), "no element <SplitVars>"),
    (once(TREES, "<BaseValues", "<BaseValues/><BaseValues"), "2 elements <BaseValues>, one is expected"),
    (attribute(TREES, "str_TreeType", "TREE_TYPE_CLASSIFIER"), "str_TreeType 'TREE_TYPE_CLASSIFIER' is not read"),
    (attribute(TREES, "str_PostTransform", "SOFTMAX"), "str_PostTransform 'SOFTMAX' is not read"),
    (attribute(TREES, "int64_inputDimension", "0"), "a model without inputs"),
    (attribute(TREES, "int64_inputDimension", "-1"), "inputDimension is '-1', expected is a whole number up to 65,536"),
    (attribute(TREES, "int64_inputDimension", "999999999999"), "expected is a whole number up to 65,536"),
    (attribute(TREES, "int64_inputDimension", "9" * 5000), "expected is a whole number"),
    (attribute(TREES, "int64_inputDimension", "٣"), "expected is a whole number"),
    (attribute(TREES, "int64_inputDimension", "1"), "an input outside 0 .. 0"),
    (attribute(TREES, "int64_numTrees", "3"), "3 trees announced, the parameters have another number"),
    (attribute(TREES, "int64_numTrees", "900000000"), "numTrees is '900000000', expected is a whole number up to 4"),
    (attribute(TREES, "int64_ND_1", "7"), "announced numbers of nodes: "),
    (attribute(TREES, "arrfp64_TR_0", "1,2"), "tree 0: 2 values"),
    (attribute(TREES, "arrfp64_TR_0", "NaN,2,3"), "TR_0: 'NaN' is no finite number"),
    (attribute(TREES, "arrfp64_TR_0", "1e999,2,3"), "TR_0 has a number that is not finite"),
    (attribute(TREES, "arrfp64_TR_0", "1,,3"), "TR_0: could not convert"),
    (attribute(TREES, "arrfp64_TR_0", ""), "TR_0: could not convert"),
    (attribute(TREES, "arrint64_TR_0", "0.5"), "TR_0 has a number that is no whole number"),
    (attribute(TREES, "arrfp64_Weights", "1,2,3"), "the leaf values (3) are not those of the"),
    (attribute(TREES, "fp64_BaseValues", "1,2"), "BaseValues has 2 numbers, one is expected"),
    (attribute(TREES, "int64_N", "2"), "trees with several outputs are not read"),
    (attribute(TREES, "str_type", "LOG"), "the transformation 'LOG' is not read"),
    (attribute(TREES, "arrfp64_offsets", "1,2"), "3 scalings and 2 offsets for 3 columns"),
    (attribute(NETWORK, "int64_numLayers", "3"), "expected is a whole number up to 2"),
    (attribute(NETWORK, "int64_numLayers", "1"), "elements MlpLayer1, MlpLayer2, ..: 1 announced, 2 there"),
    (attribute(NETWORK, "int64_numInputNeurons", "4"), "weights of shape (2, 4), expected is (2, 5)"),
    (attribute(NETWORK, "bool_usesBias", "false"), "weights of shape (2, 4), expected is (2, 3)"),
    (attribute(NETWORK, "int64_numNeurons", "60000"), "expected is (60000, 4)"),
    (attribute(NETWORK, "int64_rows", "3"), "rows is '3', expected is a whole number up to 2"),
    (attribute(NETWORK, "int64_rows", "1"), "elements Row1, Row2, ..: 1 announced, 2 there"),
    (attribute(NETWORK, "int64_columns", "60000"), "rows of 60000 numbers are announced, there are some of [4]"),
    (attribute(NETWORK, "arrfp32_vals", "1,2,3,1e39"), "vals has a number beyond float32"),
    (once(NETWORK, 'str_type="DENSE"', 'str_type="CONV"'), "a layer 'CONV' is not read"),
    (once(NETWORK, "ACT_FN_TANH\">", 'ACT_FN_SOFTSIGN">'), "the activation function 'SOFTSIGN' is not read"),
    (attribute(SVM, "str_operationType", "SVM_TYPE_ONE_CLASS"), "support vectors for 'ONE_CLASS' are not read"),
    (attribute(SVM, "str_kernelFunction", "KERNEL_FN_CHI2"), "the kernel 'CHI2' is not read"),
    (re.sub(r' fp64_gamma="[^"]*"', "", SVM), "no attribute 'arrfp64_gamma'"),
    (attribute(SVM, "int64_numSVs", "2"), "expected are 2 vectors of 3 numbers"),
    (attribute(SVM, "fp64_gamma", "-1"), "gamma -1.0 is negative"),
    (without(SVM, "SupportVectors"), "no element <SupportVectors>"),
    (attribute(SVM, "fp64_rhoConstants", "1,2"), "2 rhoConstants for 2 classes"),
    (without(attribute(NETWORK, "int64_numLayers", "0"), *["MlpLayer1", "MlpLayer2"] * 2), "a network without layers"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), CASES, ids=[message[:40] for _, message in CASES])
def test_what_is_wrong_is_said(text, message):
    with pytest.raises(InputError) as caught:
        read(text)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("children", ["1,0,0,1,0,0", "0,0,0,1,0,0", "1,1,0,2,2,0", "1,2,0,2,0,0", "1,0,0,-1,0,0"])
def test_nodes_that_form_no_tree_are_refused(children):
    text = only_file(MODELS["one leaf"])
    text = once(text, 'int64_ND_0="1" fp64_TR_0=', 'int64_ND_0="3" arrfp64_TR_0=')
    text = re.sub(r'arrfp64_TR_0="[^"]*"', 'arrfp64_TR_0="1,2,3"', text)
    text = once(text, 'int64_ND_0="1" int64_TR_0="0"', 'int64_ND_0="3" arrint64_TR_0="0,0,0"')
    text = once(text, 'int64_ND_0="1" arrint64_TR_0="0,0"', f'int64_ND_0="3" arrint64_TR_0="{children}"')
    with pytest.raises(InputError):
        read(text)


@pytest.mark.parametrize("name", FILES)
def test_other_spellings_of_the_vendors_tools_are_read(name):
    """The first exporters wrote int_ for int64_, capitals in names, blanks in lists."""
    text = FILES[name].replace("int64_", "int_").replace(",", ", ").replace("DENSE", "dense")
    text = text.replace("mlp_neural_network", "Mlp_Neural_Network").replace("<CustomAttributes />", "")
    text = text.replace("arrint_", "arrint32_").replace(' defaultEngine="mlp_fp32_engine"', "")
    x = np.random.default_rng(0).normal(size=(20, 3))
    assert np.array_equal(read(text).predict(x), read(FILES[name]).predict(x))


def test_entities_are_refused_before_they_are_expanded():
    levels = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 10))
    bomb = f'<!DOCTYPE x [<!ENTITY e0 "1">{levels}]><MLlib_XML_File a="&e9;"/>'
    for content in (bomb.encode(), f'<?xml version="1.0" encoding="UTF-7"?>{bomb}'.encode("utf-7")):
        with pytest.raises(InputError):
            read(content)


@pytest.mark.parametrize("name", FILES)
def test_every_cut_of_a_file_is_an_error(name):
    text = FILES[name]
    for at in range(0, len(text) - len("</MLlib_XML_File>\n"), 97):
        with pytest.raises(InputError, match=r"m\.xml"):
            read(text[:at])


@examples()
@given(name=st.sampled_from(sorted(FILES)), seed=st.integers(0, 2**32))
def test_a_damaged_file_is_read_or_refused_in_bounded_memory(name, seed):
    chance = random.Random(seed)
    text = FILES[name]
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(text))
        piece = text[(other := chance.randrange(len(text))) : other + chance.choice([1, 20, 200])]
        new = chance.choice(["", "9", "99999999", "-", "e", "<", '"', "nan", piece])
        text = text[:at] + new + text[at + chance.choice([0, 1, 1, 20]) :]
    tracemalloc.start()
    try:
        model = read(text)
        model.predict(np.zeros((2, len(model.ir.features))))
    except InputError as error:
        assert str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 100 * len(text) + 20_000_000


def test_a_file_with_several_engines_is_refused():
    model = TREES[TREES.index("\t<MachineLearningModel") : TREES.index("</MLlib_XML_File>")]
    with pytest.raises(InputError, match="several engines in a file are not read"):
        read(once(TREES, "</MLlib_XML_File>", model + "</MLlib_XML_File>"))
    assert issubclass(UnsupportedModelError, InputError)


@pytest.mark.parametrize("engine", ["st", "reference", "source"])
def test_the_command_predicts_from_a_file(engine, tmp_path, monkeypatch):
    (tmp_path / "net.xml").write_text(NETWORK)
    (tmp_path / "x.csv").write_text("f0,f1,f2\n0.5,1,-2\nnan,0,0\n")
    arguments = ["predict", str(tmp_path / "net.xml"), "--input", str(tmp_path / "x.csv"), "--engine", engine]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--output", str(tmp_path / "y.csv")])
    assert not ended.value.code
    header, first, second = (tmp_path / "y.csv").read_text().splitlines()
    assert (header, second) == ("net", "nan")
    expected = load_model(tmp_path / "net.xml", "net").predict(np.array([[0.5, 1.0, -2.0]]))[0, 0]
    assert float(first) == pytest.approx(expected, rel=1e-5)


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path):
    (tmp_path / "net.xml").write_text(NETWORK, encoding="utf-8-sig")
    assert load_model(tmp_path / "net.xml", "net").ir.features
