"""The first-hand Gaussian filter of a robot that knows where it is: pose and lasting errors of its sensors."""
