"""What docs/models.md says is refused: the page has this list, and each is refused in one line with these words."""

from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from sklearn import (
    calibration,
    cluster,
    dummy,
    ensemble,
    gaussian_process,
    impute,
    kernel_approximation,
    kernel_ridge,
    linear_model,
    multiclass,
    multioutput,
    naive_bayes,
    neighbors,
    pipeline,
    preprocessing,
    svm,
    tree,
)
from sklearn.experimental import enable_iterative_imputer  # noqa: F401 - imported for what it does

from st_codegen.errors import InputError
from st_codegen.walkers.files import load_model
from tests.classifiers import SCORE, THREE, TWO, X, loaded

PAGE = Path(__file__).parents[2] / "docs" / "models.md"
LABELS = np.column_stack([TWO, THREE > 0]).astype(int)
TEXTS = np.array([["a"], ["b"], ["c"]])[THREE]


def before(step, x=X):
    """A step in front of a model."""
    return pipeline.make_pipeline(step, linear_model.Ridge()).fit(x, SCORE)


def lightgbm(**options):
    made = pytest.importorskip("lightgbm").LGBMClassifier(n_estimators=2, num_leaves=4, verbose=-1, **options)
    return made.fit(X, TWO.astype(int))


def xgboost(**options):
    made = pytest.importorskip("xgboost").XGBRegressor(n_estimators=2, max_depth=2, nthread=1, **options)
    return made.fit(X, SCORE)


def saved(write):
    """A file of XGBoost's, as a function of a booster and a path writes it."""

    def made(folder):
        write(xgboost().get_booster(), folder / "m.json")
        return load_model(folder / "m.json", "m")

    return made


def deviation(_):
    several = gaussian_process.GaussianProcessRegressor(alpha=1.0, optimizer=None)
    return loaded(several.fit(np.resize(X, (513, 3)), np.resize(SCORE, 513)), {"mean", "deviation"})


def with_choice(estimator, name, choice):
    """As the pickle of an older version has it, whose class took it."""
    vars(estimator)[name] = choice
    return estimator


#: By library, the words of the page, what makes such a model (or loads it from a folder), and words of the message.
REFUSED = {
    "scikit-learn": {
        "IterativeImputer": (lambda: before(impute.IterativeImputer()), "IterativeImputer is not supported"),
        "SplineTransformer with 'continue' beyond its knots": (
            lambda: before(preprocessing.SplineTransformer(extrapolation="continue")),
            "extrapolation='continue'",
        ),
        "categories that are texts": (
            lambda: before(preprocessing.OneHotEncoder(), TEXTS),
            "has categories that are no numbers",
        ),
        "QuantileTransformer with a normal distribution, or of numbers below 0, behind a sparse matrix, whose zeros it "
        "leaves as they are": (
            lambda: before(
                pipeline.make_pipeline(
                    preprocessing.OneHotEncoder(),
                    preprocessing.QuantileTransformer(n_quantiles=5, output_distribution="normal"),
                ),
                np.round(X),
            ),
            "QuantileTransformer of a sparse matrix, of which it leaves the zeros as they are",
        ),
        "KBinsDiscretizer with dtype=float32": (
            lambda: before(preprocessing.KBinsDiscretizer(3, dtype=np.float32)),
            "KBinsDiscretizer with dtype=float32",
        ),
        "functions of a FunctionTransformer that are not listed above": (
            lambda: before(preprocessing.FunctionTransformer(np.cbrt)),
            "func=cbrt: a function that is not compiled",
        ),
        "FeatureAgglomeration by another function than the mean": (
            lambda: before(cluster.FeatureAgglomeration(2, pooling_func=np.max)),
            "pooling_func other than numpy.mean",
        ),
        "functions with arguments (`kw_args`) other than the limits of clip": (
            lambda: before(preprocessing.FunctionTransformer(np.square, kw_args={"dtype": float})),
            "arguments are not supported",
        ),
        "KNNImputer with a metric of its own": (
            lambda: before(impute.KNNImputer(metric=lambda a, b, missing_values: 1.0)),
            "supported is 'nan_euclidean'",
        ),
        "kernels that are precomputed, or functions": (
            lambda: svm.SVR(kernel="precomputed").fit(X @ X.T, SCORE),
            "kernel=precomputed",
        ),
        "kernels of KernelRidge, KernelPCA and Nystroem other than the linear, the polynomial, the RBF and the sigmoid "
        "one": (
            lambda: kernel_ridge.KernelRidge(kernel="laplacian").fit(X, SCORE),
            "supported are linear, poly, rbf, sigmoid",
        ),
        "Nystroem with `kernel_params`": (
            lambda: before(kernel_approximation.Nystroem("rbf", kernel_params={"gamma": 1.0}, n_components=3)),
            "by their own parameters",
        ),
        "kernels of Gaussian processes other than sums and products of ConstantKernel, DotProduct, ExpSineSquared, "
        "Matern, RBF, RationalQuadratic and WhiteKernel": (
            lambda: gaussian_process.GaussianProcessRegressor(
                gaussian_process.kernels.RBF() ** 2, optimizer=None, alpha=1.0
            ).fit(X, SCORE),
            "a Gaussian process with Exponentiation",
        ),
        "neighbours that were fitted on a sparse matrix": (
            lambda: neighbors.KNeighborsRegressor(3).fit(sparse.csr_matrix(X), SCORE),
            "was fitted on a sparse matrix",
        ),
        "distances other than the Euclidean, the Manhattan and the Chebyshev one": (
            lambda: neighbors.KNeighborsRegressor(metric="canberra").fit(X, SCORE),
            "metric='canberra'",
        ),
        "weights by distance within a radius": (
            lambda: neighbors.RadiusNeighborsRegressor(weights="distance").fit(X, SCORE),
            "supported are uniform",
        ),
        "weights of neighbours by a function": (
            lambda: neighbors.KNeighborsRegressor(3, weights=np.ones_like).fit(X, SCORE),
            "supported are uniform, distance",
        ),
        "LocalOutlierFactor without novelty": (lambda: neighbors.LocalOutlierFactor().fit(X), "novelty=True only"),
        "NearestCentroid with priors that differ": (
            lambda: neighbors.NearestCentroid(priors=[0.1, 0.9]).fit(X, TWO),
            "equal priors",
        ),
        "Matern kernels with a `nu` other than 0.5, 1.5, 2.5 and infinity": (
            lambda: gaussian_process.GaussianProcessRegressor(
                gaussian_process.kernels.Matern(nu=1.0), optimizer=None, alpha=1.0
            ).fit(X, SCORE),
            "Matern with nu=1.0",
        ),
        "standard deviations of Gaussian processes of more than 512 training rows": (
            deviation,
            "at most 512 training rows",
        ),
        "SVC with `break_ties` and 'ovo' (scikit-learn raises, too)": (
            lambda: svm.SVC(break_ties=True, decision_function_shape="ovo").fit(X, THREE),
            "its own predict raises",
        ),
        "probabilities of Gaussian processes of more than 512 training rows where the whole needs them": (
            lambda: ensemble.VotingClassifier(
                [("a", gaussian_process.GaussianProcessClassifier(optimizer=None))], voting="soft"
            ).fit(np.resize(X, (513, 3)), np.resize(TWO, 513)),
            "its probabilities are not compiled",
        ),
        "AdaBoostClassifier that was trained with algorithm='SAMME.R' (the default of scikit-learn up to 1.5)": (
            lambda: with_choice(ensemble.AdaBoostClassifier().fit(X, TWO), "algorithm", "SAMME.R"),
            "of which newer versions of scikit-learn compute other numbers",
        ),
        "LogisticRegression that was trained with multi_class='ovr' or solver='liblinear', or by scikit-learn up to "
        "1.5 with solver='newton-cholesky', of three and more classes, or multi_class='multinomial' of two": (
            lambda: with_choice(linear_model.LogisticRegression().fit(X, THREE), "multi_class", "ovr"),
            "of which newer versions of scikit-learn compute other numbers",
        ),
        "calibration by temperature (its answer for a row depends on the other rows)": (
            lambda: calibration.CalibratedClassifierCV(tree.DecisionTreeClassifier(), method="temperature", cv=2).fit(
                X, TWO
            ),
            "supported are 'sigmoid' and 'isotonic'",
        ),
        "scalers and imputers with copy=False where other parts of the model read the same rows (the library writes "
        "into them)": (
            lambda: pipeline.make_union(preprocessing.StandardScaler(copy=False), preprocessing.MinMaxScaler()).fit(
                X.copy()
            ),
            "which writes into rows that other parts of the model read",
        ),
        "ClassifierChain by `predict_log_proba`": (
            lambda: multioutput.ClassifierChain(naive_bayes.GaussianNB(), chain_method="predict_log_proba").fit(
                X, LABELS
            ),
            "ClassifierChain by the predict_log_proba",
        ),
        "OneVsOneClassifier of regressors": (
            lambda: multiclass.OneVsOneClassifier(linear_model.Ridge()).fit(X, THREE),
            "Ridge gives numbers where classes are needed",
        ),
        "DummyClassifier that draws at random": (
            lambda: dummy.DummyClassifier(strategy="stratified").fit(X, TWO),
            "draws its answers at random",
        ),
        "several outputs of classes by neighbours or a DummyClassifier": (
            lambda: neighbors.KNeighborsClassifier().fit(X, LABELS),
            "several outputs of classes: train one for each",
        ),
        "labels of several outputs that are no whole numbers from -2**52 to 2**52, or that are -0": (
            lambda: tree.DecisionTreeClassifier().fit(X, LABELS.astype(str)),
            "beside other outputs: encode them as whole numbers",
        ),
    },
    "LightGBM": {
        "models with `pred_early_stop`": (lambda: lightgbm(pred_early_stop=True), "pred_early_stop"),
    },
    "XGBoost": {
        "what `dump_model` and `save_config` write": (
            saved(lambda booster, path: path.write_text(booster.save_config())),
            "save_config gives has no trees",
        ),
        "the binary format (load such a file with XGBoost 1.0 to 2.1, and save it again as JSON)": (
            saved(lambda booster, path: path.write_bytes(b"binf\0gbtree")),
            "XGBoost's binary format",
        ),
        "`missing=inf`": (lambda: xgboost(missing=np.inf), "missing=inf: use NaN or a finite number"),
    },
}


def test_the_page_has_this_list():
    """Neither more nor less: what a walker refuses beside it is a class that the table of classes does not have."""
    section = PAGE.read_text(encoding="utf-8").split("## What is refused\n")[1].split("\n## ")[0]
    found = [line for line in section.splitlines() if line.startswith("- ")]
    assert found == [f"- {library}: {'; '.join(cases)}." for library, cases in REFUSED.items()]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("make", "message"),
    [case for cases in REFUSED.values() for case in cases.values()],
    ids=[words for cases in REFUSED.values() for words in cases],
)
def test_what_the_page_says_is_refused_is_refused_in_one_line(make, message, tmp_path):
    with pytest.raises(InputError) as caught:
        loaded(make(tmp_path) if make.__code__.co_argcount else make())
    assert message in str(caught.value) and "\n" not in str(caught.value)
