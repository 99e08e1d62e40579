"""What no effect explains: which orders still hold more than noise, and how that depends on the conditions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.noise import speed_levels
from st_codegen.reconcile.fit.target import Target
from st_codegen.reconcile.judge.evidence import chi_square_tail, false_discoveries
from st_codegen.reconcile.settings import SETTINGS


@dataclass(frozen=True)
class Structure:
    """How much of a residual is structure.

    orders: int (K,); p: chance by noise alone; power: deg^2, mean square amplitude of the structured part; significant:
    after control of the false discovery rate; shares: share of the structure by factor.
    """

    orders: IntArray
    p: FloatArray
    power: FloatArray
    significant: BoolArray
    shares: tuple[dict[str, float], ...]


def structure(target: Target, residual: ComplexArray) -> Structure:
    """Test the residual of every order against levels of speed, torque and temperature, by direction."""
    data, good = target.data, target.good
    at = data.at
    z = np.where(data.orders == 0, residual.real, residual) / target.sigma
    size = np.abs(z)
    z = (z * np.minimum(1.0, SETTINGS.cut / np.maximum(size, 1e-300)))[good]
    design = {
        "constant": _dummies(np.zeros(len(at), np.int64), at.sign)[good],
        "speed": _dummies(speed_levels(at.speed_rpm), at.sign)[good],
        "torque": _dummies(_levels(at.torque_Nm), at.sign)[good],
        "temperature": _dummies(_levels(at.temperature_C), at.sign)[good],
    }
    everything = np.concatenate(list(design.values()), axis=1)
    basis = _basis(everything)
    rows, rank = len(basis), basis.shape[1]
    explained = (np.abs(basis.T @ z) ** 2).sum(axis=0)
    parts = np.where(data.orders == 0, 1, 2)
    left = np.maximum((np.abs(z) ** 2).sum(axis=0) - explained, 1e-12) / np.maximum(parts * (rows - rank), 1)
    # noise that is larger than believed must not look like structure
    scale = np.maximum(left, 1.0)
    p = np.array([chi_square_tail(float(x), int(k * rank)) for x, k in zip(explained / scale, parts, strict=True)])
    sigma2 = (target.sigma[good] ** 2).mean(axis=0)
    excess = np.maximum(explained / scale - parts * rank, 0.0) / rows * sigma2 * scale
    significant = false_discoveries(p, SETTINGS.discovery_rate) & (
        excess > SETTINGS.least_excess * parts * sigma2 * scale
    )
    shares = tuple(_shares(design, z[:, k]) for k in range(z.shape[1]))
    return Structure(data.orders, p, excess, significant, shares)


def _levels(values: FloatArray) -> IntArray:
    levels, index = np.unique(values, return_inverse=True)
    if len(levels) <= 8:
        return index.astype(np.int64)
    cuts = np.quantile(values, np.linspace(0, 1, 9)[1:-1])
    return np.searchsorted(cuts, values, side="right").astype(np.int64)


def _dummies(level: IntArray, sign: FloatArray) -> FloatArray:
    """One column for each level and direction."""
    code = level * 2 + (sign > 0)
    found: FloatArray = (code[:, None] == np.unique(code)[None, :]).astype(np.float64)
    return found


def _basis(design: FloatArray) -> FloatArray:
    u, s, _ = np.linalg.svd(design, full_matrices=False)
    found: FloatArray = u[:, s > 1e-8 * s[0]]
    return found


def _shares(design: dict[str, FloatArray], z: ComplexArray | FloatArray) -> dict[str, float]:
    """What each factor explains beyond the constant, and the constant itself, as shares of their sum."""
    constant = _basis(design["constant"])
    mean = constant @ (constant.T @ z)
    found = {"constant": float((np.abs(mean) ** 2).sum())}
    for name in ("speed", "torque", "temperature"):
        basis = _basis(design[name])
        own = float((np.abs(basis.T @ z) ** 2).sum()) - found["constant"]
        chance = float((np.abs(z) ** 2).mean()) * (basis.shape[1] - constant.shape[1])
        found[name] = max(0.0, own - min(chance, own))
    total = sum(found.values()) or 1.0
    return {name: value / total for name, value in found.items()}


@dataclass(frozen=True)
class Signature:
    """One unexplained part.

    order; rms_deg: of its structured part over all runs; share of the gap (power); dependence: shares by factor;
    direction: `both`, `forward`, `backward`; text: in words.
    """

    order: int
    rms_deg: float
    share: float
    dependence: dict[str, float]
    direction: str
    text: str


def signatures(target: Target, residual: ComplexArray, gap_power: float) -> list[Signature]:
    """Signatures of all orders with significant structure, largest first. gap_power: deg^2, of the whole gap."""
    found = structure(target, residual)
    out = []
    for k in np.flatnonzero(found.significant):
        order = int(found.orders[k])
        power = found.power[k] * (1.0 if order == 0 else 0.5)
        direction = _direction(target, residual[:, k])
        out.append(
            Signature(
                order=order,
                rms_deg=float(np.sqrt(power)),
                share=float(min(1.0, power / max(gap_power, 1e-300))),
                dependence=found.shares[k],
                direction=direction,
                text=_words(target, residual[:, k], order, found.shares[k], direction, float(np.sqrt(power))),
            )
        )
    return sorted(out, key=lambda signature: -signature.rms_deg)


def lines_in_samples(target: Target, residual: ComplexArray, gap_power: float, highest: int = 300) -> list[Signature]:
    """Signatures of samples over time: waves of the output's angle that stand above the noise."""
    data = target.data
    angle = np.zeros(len(data)) if data.angle_rad is None else data.angle_rad
    r, sigma = residual[:, 0].real, float(target.sigma[0, 0])
    left = r.copy()
    out = []
    for _ in range(SETTINGS.most_lines):
        waves = np.exp(-1j * np.outer(np.arange(highest + 1), angle))
        sums = waves @ left * (2.0 / len(left))
        sums[0] /= 2.0
        order = int(np.argmax(np.abs(sums)))
        size = float(np.abs(sums[order])) * (1.0 if order == 0 else np.sqrt(0.5))
        # noise of a line: sigma*sqrt(2/n); autocorrelation may double it
        if size < 10 * sigma / np.sqrt(len(left)) or size < 0.5 * sigma:
            break
        left -= (sums[order] * np.conj(waves[order])).real
        share = min(1.0, size**2 / max(gap_power, 1e-300))
        name = f"order {order}" if order else "the mean"
        text = f"{name}: {size:.2g} deg RMS over the recordings"
        out.append(Signature(order, size, share, {"constant": 1.0}, "both", text))
    return out


def _direction(target: Target, r: ComplexArray) -> str:
    power = {}
    for name, sign in (("forward", 1.0), ("backward", -1.0)):
        rows = target.good & (target.data.at.sign == sign)
        power[name] = float(np.median(np.abs(r[rows]) ** 2)) if rows.any() else 0.0
    loud = max(power, key=lambda name: power[name])
    return loud if power[loud] > 9 * min(power.values()) else "both"


def _words(target: Target, r: ComplexArray, order: int, shares: dict[str, float], direction: str, rms: float) -> str:
    at, good = target.data.at, target.good
    main = max(shares, key=lambda name: shares[name])
    where = f"order {order}" if order else "the mean"
    side = "" if direction == "both" else f", {direction} only"
    texts = {
        "constant": "constant over the operating points",
        "speed": "depends on the speed",
        "torque": "depends on the torque",
        "temperature": "depends on the oil temperature",
    }
    text = f"{where}: {rms:.2g} deg RMS, {texts[main]}{side}"
    if main != "constant":
        values = {"speed": at.speed_rpm, "torque": at.torque_Nm, "temperature": at.temperature_C}[main]
        size = np.abs(r)
        levels = _levels(values) if main != "speed" else speed_levels(values)
        means = {}
        for n in np.unique(levels[good]):
            rows = good & (levels == n)
            means[float(np.median(values[rows]))] = float(np.sqrt((size[rows] ** 2).mean()))
        top = max(means, key=lambda value: means[value])
        unit = {"speed": "rpm", "torque": "N m", "temperature": "degC"}[main]
        text += f", most at {top:g} {unit}"
        if main == "speed" and order:
            hertz = order * top / 60 / target.reduction_ratio
            text += f" (order {order} is at {hertz:.1f} Hz there)"
    return text
