"""The forms in which nature may have an effect: each changes how an arm realises it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
from typing import Any

from truth.configuration import Arm

# Joint travel in which bristles bend, rad: three times the angle sensors' noise, a hundredth of
# an ordinary move.
SHORT_TRAVEL = 3e-4
# Contact stiffness per inertia, 1/s^2, a tenth of the usual one: a link of the reference arm sinks
# in by a milliradian.
SOFT_CONTACT = 6e3
# Time constant with which a gauge's gain warms up, s: a third of a record's fitted part.
WARMING = 10.0
# How far from the elbow a hose is tied to the links, m.
HOSE_REACH = 0.1


def _joints(**changes: Any) -> Callable[[Arm], Arm]:
    def form(arm: Arm) -> Arm:
        first, second = (replace(joint, **changes) for joint in arm.joints)
        return replace(arm, joints=(first, second))
    return form


def _sensors(**changes: Any) -> Callable[[Arm], Arm]:
    return lambda arm: replace(arm, sensors=replace(arm.sensors, **changes))


def _payload(**changes: Any) -> Callable[[Arm], Arm]:
    return lambda arm: replace(arm, payload=replace(arm.payload, **changes))


def _lower_gauges(arm: Arm) -> Arm:
    upper = len(arm.links[0].gauges)
    return replace(arm, sensors=replace(arm.sensors, late=tuple(
        range(upper, upper + len(arm.links[1].gauges)))))


def _rubber(arm: Arm) -> Arm:
    """Let the base's mounting lose six times as much, 0.3 of what ends its swing at once."""
    return replace(arm, structure=replace(
        arm.structure, base_damping=6.0 * arm.structure.base_damping))


def _leak(arm: Arm) -> Arm:
    """Replace the payload's change by a leak, of a third of the ramp's duration, at least 1 s."""
    return replace(arm, payload=replace(
        arm.payload, leak=max(arm.payload.event_duration / 3.0, 1.0)))


def _hose(arm: Arm) -> Arm:
    """
    Span the elbow with a hose in place of a spring, equally stiff at its rest angle.

    Its length is 2 reach sin(pi/4 - angle/2); the lever of its pull is the slope of that length.
    """
    found = max(arm.joints, key=lambda joint: joint.spring)
    first, second = (replace(joint, spring=0.0) for joint in arm.joints)
    lever = HOSE_REACH * math.cos(math.pi / 4.0 - 0.5 * found.spring_rest)
    return replace(arm, joints=(first, second), structure=replace(
        arm.structure, hose_stiffness=found.spring / lever**2, hose_reach=HOSE_REACH,
        hose_rest=found.spring_rest))


FORMS: dict[str, Callable[[Arm], Arm]] = {
    'bristles': _joints(bristle=True, presliding=SHORT_TRAVEL),
    'springs': _joints(presliding=SHORT_TRAVEL),
    'soft_contact': _joints(contact_stiffness=SOFT_CONTACT),
    'sensor_on_motor': _joints(sensor_on_motor=True),
    'light_output': _joints(output_share=0.01),
    'heavy_output': _joints(output_share=0.3),
    'inside_loop': _joints(lag_inside=True),
    'one_drive': lambda arm: replace(arm, late_drives=(1,)),
    'first_order': _sensors(filter_first_order=True),
    'lower_gauges': _lower_gauges,
    'one_gauge': _sensors(late=(0,)),
    'warming': _sensors(gain_warming=WARMING),
    'half_loose': _payload(loose_share=0.5),
    'rubber': _rubber,
    'leak': _leak,
    'hose': _hose,
}
