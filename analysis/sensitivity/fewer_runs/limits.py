"""How many runs a surrogate is fitted to, and what it must explain.

Set by us. An event in 0.015 of the cube is missed by 256 runs in 2 of 100 studies, and by 64 in 38
(Hanley and Lippman-Hand 1983, If nothing goes wrong, is everything all right?).
"""

from sys import float_info

#: A study is looked at when it has its first so many runs. More are not fitted to: the cost grows
#: with their cube.
LOOKS = (128, 256, 512)
MOST_RUNS = LOOKS[-1]

#: Of fewer runs no answer is believed.
FEWEST_RUNS = 256

#: Of fewer there is no answer at all: each fold must leave something to fit to.
LEAST_RUNS = 32

#: Share of the variance of runs held out below which a surrogate is no answer.
LEAST_EXPLAINED = 0.8

#: Values that differ by less than this share of their size differ by rounding.
ROUNDING = 16.0 * float_info.epsilon
