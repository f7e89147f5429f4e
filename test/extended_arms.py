"""Arms with effects for the tests: how to make them, load them and look at them."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects import build, parse
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
from scipy.linalg import eigh

ROBOT = load_robot('reference')
TIME = np.arange(150) * ROBOT.sample_time
COMMANDS = np.stack([np.sin(4.0 * TIME), 0.8 * np.cos(5.0 * TIME)], axis=-1)


def effect(text: str) -> Effect:
    """Return the effect of a text such as coulomb_friction:joint_2:level_n_m=0.4."""
    return build(parse(text), ROBOT)


def arm(*texts: str, robot: Robot = ROBOT, model: str = 'assumed_modes', modes: int = 3,
        step: float | None = None) -> ExtendedArm:
    """Return an arm with effects."""
    return ExtendedArm(robot, model, modes, effects=[effect(text) for text in texts], step=step)


def outputs(extended: ExtendedArm) -> Array:
    """Return the outputs under COMMANDS, (150, m)."""
    return simulate(Simulator(extended), COMMANDS)[0]


def stiff(robot: Robot, factor: float = 1e4, **changes: float) -> Robot:
    """Return a robot with stiff links that do not damp."""
    for j in (0, 1):
        robot = robot.with_link(j, youngs_modulus=70e9 * factor, damping_ratio=0.0, **changes)
    return robot


def frequencies(form: SecondOrderForm, held: list[str], payload: float,
                cosine: float = 1.0) -> Array:
    """Return the natural frequencies, rad/s, with some coordinates held at zero."""
    free = [k for k, name in enumerate(form.names) if name not in held]
    pick = np.ix_(free, free)
    return np.sqrt(eigh(form.stiffness_at(cosine)[pick],
                        form.mass_at(cosine, payload)[pick], eigvals_only=True))


def moving(extended: ExtendedArm, seed: int, rate: float = 1.0) -> Motion:
    """Return 20 random motions of an arm."""
    rng, n = np.random.default_rng(seed), extended.form.order
    position = rng.normal(scale=0.01, size=(20, n))
    position[:, :2] = rng.uniform(-1.5, 1.5, (20, 2))
    velocity = rng.normal(scale=rate, size=(20, n))
    return extended.motion(np.hstack([position, velocity]), np.zeros((20, 2)), 0.0)
