"""Results of statsmodels, from pickles: linear models and GLM with every link, with and without a constant."""

import pickle

import numpy as np
import pytest

from st_codegen.errors import InputError, UnsupportedModelError, UntrustedFileError
from st_codegen.ir import reference
from st_codegen.passes.domain import limit_inputs
from st_codegen.proof.bounds import difference_bound
from st_codegen.walkers.files import load_model

sm = pytest.importorskip("statsmodels.api")
pd = pytest.importorskip("pandas")

RANDOM = np.random.default_rng(5)
X = RANDOM.normal(size=(60, 3))
Y = X @ [0.3, -0.2, 0.1] + 0.8 + 0.05 * RANDOM.normal(size=60)
LINKS = sm.families.links


def loaded(results, folder):
    path = folder / "model.pkl"
    path.write_bytes(pickle.dumps(results))
    return load_model(path, "m", trust_pickle=True)


def agrees(model, scale=1.0):
    x = np.random.default_rng(1).normal(size=(200, len(model.ir.features))) * scale
    ir = limit_inputs(model.ir)
    ours, library = reference.evaluate(ir, x), model.predict(x)
    answered = np.isfinite(ours)
    assert np.array_equal(answered, np.isfinite(library)) and answered.mean() > 0.4
    assert np.all(np.abs(ours - library)[answered] <= difference_bound(ir, x)[answered])
    return model


MODELS = {
    "OLS": lambda: sm.OLS(Y, sm.add_constant(X)),
    "OLS without a constant": lambda: sm.OLS(Y, X),
    "WLS": lambda: sm.WLS(Y, sm.add_constant(X), weights=np.linspace(1, 2, 60)),
    "GLS": lambda: sm.GLS(Y, sm.add_constant(X), sigma=np.linspace(1, 2, 60)),
    "RLM": lambda: sm.RLM(Y, sm.add_constant(X)),
    "QuantReg": lambda: sm.QuantReg(Y, sm.add_constant(X)),
    "Logit": lambda: sm.Logit(np.sin(9 * Y) > 0, sm.add_constant(X)),
    "Poisson": lambda: sm.Poisson(np.round(np.abs(Y) * 3), sm.add_constant(X)),
    "Probit": lambda: sm.Probit(np.sin(9 * Y) > 0, sm.add_constant(X)),
    "NegativeBinomial": lambda: sm.NegativeBinomial(np.round(np.abs(Y) * 3), sm.add_constant(X)),
    "NegativeBinomial geometric": lambda: sm.NegativeBinomial(
        np.round(np.abs(Y) * 3), sm.add_constant(X), loglike_method="geometric", exposure=np.full(60, 2.0)
    ),
    "NegativeBinomialP": lambda: sm.NegativeBinomialP(np.round(np.abs(Y) * 3), sm.add_constant(X)),
    "GeneralizedPoisson": lambda: sm.GeneralizedPoisson(np.round(np.abs(Y) * 3), sm.add_constant(X)),
    "GLM probit": lambda: sm.GLM(Y > 0.8, sm.add_constant(X), family=sm.families.Binomial(sm.families.links.Probit())),
    "GLM gaussian": lambda: sm.GLM(Y, sm.add_constant(X)),
    "GLM gamma log": lambda: sm.GLM(np.abs(Y), sm.add_constant(X), family=sm.families.Gamma(LINKS.Log())),
    "GLM gamma inverse": lambda: sm.GLM(np.abs(Y) + 1, sm.add_constant(X), family=sm.families.Gamma()),
    "GLM poisson": lambda: sm.GLM(np.round(np.abs(Y) * 3), sm.add_constant(X), family=sm.families.Poisson()),
    "GLM binomial": lambda: sm.GLM(Y > 0.8, sm.add_constant(X), family=sm.families.Binomial()),
    "GLM root": lambda: sm.GLM(np.abs(Y) + 1, sm.add_constant(X), family=sm.families.Poisson(LINKS.Sqrt())),
    "GLM squared": lambda: sm.GLM(np.abs(Y) + 1, sm.add_constant(X), family=sm.families.InverseGaussian()),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", MODELS)
def test_results_are_those_of_the_library(tmp_path, name):
    model = agrees(loaded(MODELS[name]().fit(), tmp_path), 0.5)
    assert len(model.ir.features) == 3
    assert model.ir.source.model_class.startswith(name.split()[0])
    for bad in (np.nan, np.inf):
        assert np.isnan(reference.evaluate(model.ir, np.array([[bad, 0.0, 0.0]])))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["OLS", "Logit", "Poisson", "GLM poisson", "NegativeBinomial", "GeneralizedPoisson"])
def test_results_of_regularized_fits(tmp_path, name):
    agrees(loaded(MODELS[name]().fit_regularized(alpha=0.1), tmp_path), 0.5)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("given", ["offset", "exposure"])
@pytest.mark.parametrize("kind", ["Poisson", "NegativeBinomial", "NegativeBinomialP", "GeneralizedPoisson"])
def test_what_each_row_of_the_fit_had_beside_its_columns_is_left_out_or_refused(tmp_path, kind, given):
    results = getattr(sm, kind)(np.round(np.abs(Y) * 3), sm.add_constant(X), **{given: np.linspace(1, 2, 60)}).fit()
    if kind in ("Poisson", "NegativeBinomial"):
        agrees(loaded(results, tmp_path), 0.5)
        return
    with pytest.raises(UnsupportedModelError, match=f"{kind} with {given}: its predict adds those of the rows"):
        loaded(results, tmp_path)


def test_columns_have_the_names_of_a_frame_and_plain_formulas_are_read(tmp_path):
    frame = pd.DataFrame(X, columns=["speed", "load", "oil"]).assign(y=Y)
    model = agrees(loaded(sm.OLS(frame["y"], frame[["speed", "load"]]).fit(), tmp_path))
    assert [feature.name for feature in model.ir.features] == ["speed", "load"]
    model = agrees(loaded(sm.OLS.from_formula("y ~ oil + load", frame).fit(), tmp_path))
    assert [feature.name for feature in model.ir.features] == ["oil", "load"]
    with pytest.raises(UnsupportedModelError, match=r"computes columns \(np.exp\(oil\)\)"):
        loaded(sm.OLS.from_formula("y ~ np.exp(oil)", frame).fit(), tmp_path)


def test_a_constant_that_is_not_one_is_a_feature(tmp_path):
    frame = pd.DataFrame(X, columns=["a", "b", "c"]).assign(const=5.0)
    assert len(agrees(loaded(sm.OLS(Y, frame).fit(), tmp_path)).ir.features) == 4


@pytest.mark.filterwarnings("ignore")
def test_what_is_refused(tmp_path):
    family = sm.families.Binomial(LINKS.CLogLog())
    with pytest.raises(UnsupportedModelError, match="the link CLogLog: supported are Identity, Log, Logit, Probit"):
        loaded(sm.GLM(Y > 0.8, sm.add_constant(X), family=family).fit(), tmp_path)
    with pytest.raises(UnsupportedModelError, match="statsmodels's ZeroInflatedPoissonResultsWrapper is not supported"):
        loaded(sm.ZeroInflatedPoisson(np.round(np.abs(Y) * 3), X).fit(disp=0), tmp_path)
    with pytest.raises(UnsupportedModelError, match="statsmodels's MultinomialResultsWrapper is not supported"):
        loaded(sm.MNLogit(np.arange(60) % 3, X).fit(disp=0), tmp_path)
    with pytest.raises(InputError, match="no columns but a constant"):
        loaded(sm.OLS(Y, np.ones(60)).fit(), tmp_path)
    path = tmp_path / "model.pkl"
    with pytest.raises(UntrustedFileError, match="--trust-pickle"):
        load_model(path, "m")
