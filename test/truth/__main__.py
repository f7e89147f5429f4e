"""Make a short record of each arm, so that the loops are compiled once: `python -m truth`."""

from truth.configuration import ROBOTS
from truth.records import make_record, TruthCase

for robot in ROBOTS:
    make_record(TruthCase(seed=0, robot=robot, duration_s=0.1))
