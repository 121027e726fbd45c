"""One line of JSON in, one out; all random numbers are drawn from the seed."""

import json
import sys
from random import Random

#: Nm of the motor, and standard deviation of the sensor, rad.
TORQUE, NOISE = 0.5, 0.01

for line in sys.stdin:
    asked = json.loads(line)
    x = asked["parameters"]
    angle = x["motor_gain"] * TORQUE / x["stiffness"]
    angle += Random(asked["seed"]).gauss(0.0, NOISE)
    print(json.dumps({"outputs": {"rest_angle": angle}}), flush=True)
