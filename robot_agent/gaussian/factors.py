"""By which factor a kind of noise is larger or smaller than its model says, by the errors that were seen. Pure.

The logarithm of the factor s of a sigma has a mean and a sigma over a grid, by the likelihood of what was seen and a log-normal
prior. Where somebody gave the model, s is the median: the prior holds back what may be luck. Where the model is a guess, s^2 is its
expected value, so that doubt counts as noise. A fix or a compass may claim to be far better than it is, so there the prior is
Student's t.
"""

from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.grid import Array

MEMORY = 40.0  # samples after which what was seen has faded to 1 / e
LOGS = np.arange(-3.0, 3.01, 0.25)  # binary logarithms of s
CLAIMED_LOGS = np.arange(-3.0, 10.01, 0.25)  # where the model is only claimed
TAILS = 2.0  # degrees of freedom of a claim's prior, Student's t: a factor of 300 is 5 nats less likely than 1, not 34
#: The correlation of the logarithms of two kinds of noise that are found together: one floor and one pair of wheels make both.
#: None where one model was given and the other is a guess.
TOGETHER = 0.8


@dataclass
class NoiseFactor:
    """Mutable: the factor of one kind of noise; `variance` is s^2, at least `least`."""

    least: float = 0.0
    given: bool = True  # whether somebody gave the model; otherwise its doubt counts, too
    mean: float = 0.0  # of the binary logarithm of s
    sigma: float = 1.0
    is_judged: bool = False
    _expected: float = 1.0  # s^2

    @property
    def variance(self) -> float:
        """Relative to the model's."""
        if not self.given:
            return max(self.least, self._expected)
        return max(self.least, float(4.0**self.mean))

    @property
    def log(self) -> tuple[float, float]:
        """Mean and sigma of the binary logarithm of s."""
        return self.mean, self.sigma

    @property
    def at_least(self) -> float:
        """The binary logarithm of s, less one sigma."""
        return self.mean - self.sigma

    def take(self, weights: Array, logs: Array) -> None:
        """Its posterior is this, shape (n,), over these logarithms of s, shape (n,)."""
        self.is_judged = True
        self._expected = float(weights @ 4.0**logs)
        self.mean = float(weights @ logs)
        self.sigma = float(np.sqrt(weights @ (logs - self.mean) ** 2))


@dataclass
class NoiseFactors:
    """Mutable: the factors of kinds of noise that make one error together, by the likelihood of each combination.

    The prior of their logarithms is normal, one sigma of which is a factor of 2, or Student's t where they are only claimed. A given
    model is its median; a guess is what the prior expects s^2 to be.
    """

    kinds: tuple[NoiseFactor, ...]
    wild: bool = False  # whether the model is only claimed, and may be wrong by a factor of a thousand
    _logs: Array = field(init=False)  # binary logarithms of s, shape (n,)
    _prior: Array = field(init=False)  # logarithms, shape (n,) * kinds
    _seen: Array = field(init=False)  # the log-likelihood of each combination, faded, as `_prior`
    _variances: Array = field(init=False)  # of each combination, shape (n ** kinds, kinds)

    def __post_init__(self) -> None:
        number = len(self.kinds)
        self._logs = CLAIMED_LOGS if self.wild else LOGS
        combined = np.stack(np.meshgrid(*[self._logs] * number, indexing="ij"), axis=-1)
        apart = combined - [0.0 if kind.given else -np.log(2) for kind in self.kinds]
        alike = TOGETHER if len({kind.given for kind in self.kinds}) == 1 else 0.0
        # A factor below its bound is used as the bound, so it has the bound's likelihood and says no more of the other kind.
        least = [kind.least if alike else 0.0 for kind in self.kinds]
        correlation = alike + (1 - alike) * np.eye(number)
        squared = np.sum(apart @ np.linalg.inv(correlation) * apart, axis=-1)
        self._prior = -0.5 * (TAILS + number) * np.log1p(squared / TAILS) if self.wild else -0.5 * squared
        self._seen = np.zeros_like(self._prior)
        self._variances = np.maximum(least, 4.0 ** combined.reshape(-1, number))

    def weigh(self, error: Array, rest: Array, added: Array) -> None:
        """Take an error, shape (n,), whose covariance is `rest`, (n, n), and s^2 times `added`, (kinds, n, n), of each kind."""
        variances = np.array([kind.variance for kind in self.kinds])
        present = float(error @ np.linalg.solve(rest + np.tensordot(variances, added, 1), error))
        farthest = quantile(GATE, len(error))  # farther off, as by a misread barcode, counts as this
        nearer = farthest / max(farthest, present)
        covariances = rest + np.tensordot(self._variances, added, 1)
        squared = nearer * np.einsum("i,kij,j->k", error, np.linalg.inv(covariances), error)
        likelihood = -0.5 * (squared + np.linalg.slogdet(covariances)[1])
        self._seen = self._seen * np.exp(-1 / MEMORY) + likelihood.reshape(self._seen.shape)
        logs = self._prior + self._seen
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        for axis, kind in enumerate(self.kinds):
            kind.take(weights.sum(axis=tuple(other for other in range(len(self.kinds)) if other != axis)), self._logs)
