"""The [world.check] table of a scenario: what a run must show to PASS."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from blackboard.config import Positive, Section


class CheckSection(Section):
    """What a run must show to PASS, of robots and objects alike unless it says otherwise."""

    robots: Positive = 0.9
    "[factor] Agreed RMSE of the robots' positions, at most so much of solo."
    objects: Positive = 0.9
    "[factor] Agreed RMSE of the objects, at most so much of solo."
    entropy: Positive = 1.0
    "[factor] Agreed entropy, at most so much of solo."
    coverage: Annotated[float, Field(ge=0, le=1)] = 0.8
    "[share] Share of the agreed 95 % regions that hold the truth, at least."
    calibration: Annotated[float, Field(ge=0, le=1)] = 0.2
    "[share] How far the coverage of agreed regions may be, beyond doubt, from 50, 90 and 95 %, to both sides."
    missing: Annotated[float, Field(ge=0, le=1)] = 0.2
    "[share] Share of the samples of a robot or object that may be missing."
    claim: Positive = 2.0
    "[factor] Solo RMSE of the robots, and of each one, at most so many times what its beliefs claim."
    solo: Positive | None = None
    "[unit] Solo RMSE of the robots, at most; anything where it is not given."
