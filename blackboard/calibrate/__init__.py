"""What the sensors of a team are like, found from its own readings without any truth: `blackboard calibrate`. Pure."""
