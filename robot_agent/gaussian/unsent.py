"""Evidence that was not sent: the next that is sent is gained over what was known before it. Pure."""

from dataclasses import dataclass

from blackboard.opinion.gaussian.joint import Joint, Moments


@dataclass
class Unsent:
    """Mutable; `predict` once per tick, before its evidence is taken, and `silent` where that evidence was not sent."""

    robot: str
    #: The robot's block as predicted for this tick from what was sent: without this tick's evidence and any that was not sent.
    before: Moments | None = None
    joint: Joint | None = None  # the same for the motions that come; None if the newest evidence was sent

    def predict(self, prediction: Moments | None) -> None:
        """A tick's evidence comes over this prediction, unless evidence before it was not sent."""
        self.before = prediction if self.joint is None else self.joint.moments(self.robot)
        self.joint = None

    def silent(self) -> None:
        """The evidence of the newest tick was not sent."""
        if self.before is not None:
            self.joint = Joint()
            self.joint.add(self.robot, self.before)

    def forget(self) -> None:
        """The belief was given up: nothing is gained over it."""
        self.before = self.joint = None
