"""One line of JSON in, one out: {"parameters": {"x1": 0.3, ...}, "seed": 7}."""

import json
import sys
from math import sin

for line in sys.stdin:
    x = json.loads(line)["parameters"]
    y = sin(x["x1"]) + 7 * sin(x["x2"]) ** 2 + 0.1 * x["x3"] ** 4 * sin(x["x1"])
    print(json.dumps({"outputs": {"y": y}}), flush=True)
