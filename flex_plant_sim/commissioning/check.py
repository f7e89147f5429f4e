"""The check of a robot file by `flex_robot check`: all figures that need no log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.commissioning.observability import Observability, observability
from flex_plant_sim.commissioning.plausibility import hints
from flex_plant_sim.commissioning.summary import (
    closed_modes,
    ClosedLoopMode,
    locked_modes,
    tip_force,
)
from flex_plant_sim.diagnosis.verdict.wording import digits_text

# Number of modes in the table: two for each link, as in the paper's model.
SHOWN_MODES = 4


@dataclass(frozen=True)
class Check:
    """
    The figures of an arm that can be computed before it moves.

    Attributes
    ----------
    robot : Robot
    modes : int
        Modes per link.
    hints : tuple of str
    bare, loaded : tuple of float
        Natural frequencies with the joints held, without and with the payload, Hz.
    closed : tuple of ClosedLoopMode
        Modes with the drives active, with the payload.
    deflection : float
        Deflection of the tip under 1 N across it, m.
    strain : Mapping
        Strain at the gauges under 1 N across the tip, m/m.
    payload : Observability

    """

    robot: Robot
    modes: int
    hints: tuple[str, ...]
    bare: tuple[float, ...]
    loaded: tuple[float, ...]
    closed: tuple[ClosedLoopMode, ...]
    deflection: float
    strain: Mapping[str, float]
    payload: Observability

    @classmethod
    def of(cls, robot: Robot, modes: int) -> Check:
        """Return the check of a robot."""
        bent = tip_force(robot, modes)
        bare, loaded = (
            tuple(float(f) for f in locked_modes(robot, modes, mass)[0][:SHOWN_MODES])
            for mass in (0.0, robot.payload_mass))
        strain = tuple(map(float, bent.strain))
        return cls(robot, modes, hints(robot, loaded, bent.deflection, strain), bare, loaded,
                   closed_modes(robot, modes, robot.payload_mass)[:SHOWN_MODES], bent.deflection,
                   dict(zip(robot.gauge_names, strain)), observability(robot, modes))

    def results(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            'robot': self.robot.name, 'modes': self.modes, 'hints': list(self.hints),
            'not_in_file': dict(self.robot.left_out),
            'payload_kg': self.robot.payload_mass,
            'locked_hz': {'no_payload': list(self.bare), 'payload': list(self.loaded)},
            'closed': [{'hz': mode.frequency, 'damping_ratio': mode.damping}
                       for mode in self.closed],
            'tip_deflection_m_per_n': self.deflection, 'strain_per_n': dict(self.strain),
            'payload_std_kg': {'parts_exact': self.payload.exact,
                               'parts_within_tolerances': self.payload.within_tolerances},
            'move_s': self.payload.move.stroke * self.payload.move.strokes}

    def text(self) -> str:
        """Return the figures as text."""
        parts = [self._plausible(), self._left_out(), self._frequencies(), self._gauges(),
                 self._payload()]
        return '\n\n'.join(filter(None, parts))

    def _plausible(self) -> str:
        if not self.hints:
            return f'{self.robot.name}: every number is one that an arm can have'
        lines = [f'{self.robot.name}: look again at', *(f'  {line}' for line in self.hints)]
        return '\n'.join(lines)

    def _left_out(self) -> str:
        sections: dict[str, list[str]] = {}
        for key, value in self.robot.left_out.items():
            section, _, name = key.rpartition('.')
            said = f'{value:g}' if math.isfinite(value) else 'none'
            sections.setdefault(section, []).append(f'{name} {said}')
        lines = [f'  {section}: {", ".join(items)}' for section, items in sections.items()]
        return '\n'.join(['not in the file, so taken as usual', *lines]) if lines else ''

    def _frequencies(self) -> str:
        names = ''.join(f'{f"mode {k + 1}":>10}' for k in range(len(self.bare)))
        load = f'joints held, {self.robot.payload_mass:g} kg'
        rows = [f'{"natural frequency, Hz, elbow straight":<40}{names}',
                _row('joints held, no payload', self.bare, '.2f'), _row(load, self.loaded, '.2f'),
                _row('drives at work', [m.frequency for m in self.closed], '.2f'),
                _row('  damping ratio', [m.damping for m in self.closed], '.3f')]
        return '\n'.join(rows)

    def _gauges(self) -> str:
        lines = [f'1 N across the tip bends it by {1e3 * self.deflection:.3g} mm and strains']
        noise = self.robot.strain_noise
        lines += [f'  {name:<12}{1e6 * strain:8.1f} um/m; its noise is worth '
                  f'{digits_text(1e3 * noise / abs(strain), 2)} mN' if strain else
                  f'  {name:<12} not at all: it sits where the link does not bend'
                  for name, strain in self.strain.items()]
        return '\n'.join(lines)

    def _payload(self) -> str:
        move, mass = self.payload.move, self.robot.payload_mass
        swings = ' and '.join(dict.fromkeys(f'{2.0 * size:.3g}' for size in move.amplitude))
        return '\n'.join([
            f'a log of {move.strokes} strokes of {swings} rad, {move.stroke:g} s each, could tell '
            f'the payload of {1e3 * mass:g} g to', *(
                f'  ± {digits_text(1e3 * std, 2)} g   {words}' for std, words in (
                    (self.payload.exact, 'if every part were as the file says'),
                    (self.payload.within_tolerances,
                     'with every part unknown within its tolerance'))),
            '(Cramer-Rao bound: no estimator can do better; friction and the like come on top)'])


def _row(label: str, values: Any, form: str) -> str:
    return f'  {label:<38}' + ''.join(f'{value:>10{form}}' for value in values)
