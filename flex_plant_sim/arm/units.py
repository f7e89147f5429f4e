"""The units in which people read quantities, by SI unit, and gravity."""

from __future__ import annotations

import math

# Factor and name of the unit in which a quantity is shown; others as they are.
SHOWN = {'m/m': (1e6, 'µm/m'), 'm/m/s': (1e6, 'µm/m/s'),
         # Beside a parameter's name, `modes`: modes 4 a link.
         'modes a link': (1.0, 'a link')}
# The same for a measured channel: its angles in degrees, those of robot files stay in rad.
CHANNEL_SHOWN = {**SHOWN, 'rad': (180.0 / math.pi, '°')}
# Gravitational acceleration, m/s^2; within 0.3 % anywhere on earth.
GRAVITY = 9.81
