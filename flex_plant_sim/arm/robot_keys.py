"""
The keys of a robot file: unit, meaning and how to measure each value.

The template of a robot file and docs/robot_file.md are written from this table.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Key:
    """
    One key of the robot file.

    Attributes
    ----------
    name, unit, meaning, measure : str
        The unit is empty for a number without one; measure says how to obtain the value.
    examples : tuple of str
        Values in the template: one text, or one for each place of the group.
    default : str
        Value that holds if the key is left out; empty if the key is required.

    """

    name: str
    unit: str
    meaning: str
    measure: str
    examples: tuple[str, ...]
    default: str = ''


@dataclass(frozen=True)
class KeyGroup:
    """
    Keys that belong to one mapping of the robot file.

    Attributes
    ----------
    title, about : str
    places : tuple of str
        Paths of the mapping, for example links.upper and links.lower; '' is the top of the file.
    keys : tuple of Key
    kind : str
        Kind of drive that has these keys; empty in other groups.
    examples : tuple of str
        Places at which the template has this kind of drive.

    """

    title: str
    about: str
    places: tuple[str, ...]
    keys: tuple[Key, ...]
    kind: str = ''
    examples: tuple[str, ...] = ()


LINK = (
    Key('length_m', 'm', 'Flexible length, from the clamp to the next axis or the payload.',
        'Ruler, to 1 mm.', ('0.40', '0.35')),
    Key('thickness_m', 'm', 'Thickness in the direction in which the link bends.',
        'Micrometer, at five places: stiffness goes with its cube.', ('0.0025', '0.0015')),
    Key('height_m', 'm', 'The other side of the cross-section, upright when the arm moves flat.',
        'Caliper.', ('0.050', '0.040')),
    Key('youngs_modulus_pa', 'Pa', "Young's modulus of the material.",
        'Data sheet: aluminium 70e9, steel 205e9; or hang a known mass on the tip and measure '
        'the deflection.', ('70.0e9', '70.0e9')),
    Key('density_kg_per_m3', 'kg/m^3', 'Density of the material, cables and gauges included.',
        'Weigh the bare link, divide by length, thickness and height.', ('2700', '2700')),
    Key('damping_ratio', '', 'Damping ratio of the first mode of the bare link, clamped. The '
        "model's ratio grows with frequency, so that on the arm, where it swings slower, the link "
        'has less.', 'Clamp it, pluck it; ln(ratio of two peaks in a row) / 6.28. For a link that '
        'keeps its ratio on the arm, times the bare frequency over that on the arm.',
        ('0.01', '0.01')),
    Key('gauge_positions_m', 'm', 'Distance of each strain gauge from the clamp; [] if none.',
        'Ruler. Best near the clamp; their names are strain_1a, strain_1b, …, link by link.',
        ('[0.03]', '[0.03]')),
    Key('hub_radius_m', 'm', 'From the joint axis to the clamp, rigid.', 'Ruler.',
        ('0.03', '0.02'), default='0'),
)

DRIVE_ENDS = (
    Key('command_limit', "drive's own unit", 'Largest command that the drive obeys.',
        'Data sheet, or the limit set in the driver.', ('3.0', '3.0'),
        default='none'),
    Key('angle_limits_rad', 'rad', 'Smallest and largest joint angle; set-points beyond them '
        'are refused, and `flex_robot move` goes half of the way to them at most.',
        'Turn the joint to its stops by hand and read the angles.',
        ('[-1.5, 1.5]', '[-2.0, 2.0]'), default='none'),
)
INERTIA = Key('inertia_kg_m2', 'kg m^2', 'Rotor and gear, seen from the joint: what turns with '
              "the joint's angle, whatever the link that carries the motor does.",
              'Data sheet of the motor, times the gear ratio squared. Shoulder: plus the hub. '
              "Elbow: not the lower link's hub, nor the rotor of a direct drive; they turn with "
              'the link and are the effect hub_inertia at joint_2.',
              ('0.08', '0.02'))

VELOCITY_LOOP = (
    INERTIA,
    Key('time_constant_s', 's', 'Time constant of the closed velocity loop, links taken off.',
        'Command a step of speed; the time to 63 % of it.', ('0.01', '0.01')),
    Key('gain_rad_per_s', 'rad/s', 'Joint speed for a command of 1.',
        'Command a slow constant speed; divide the measured speed by the command.',
        ('1.0', '1.0')),
    *DRIVE_ENDS)
CURRENT = (
    INERTIA,
    Key('torque_constant_n_m_per_a', 'N m/A', 'Torque at the joint for a command of 1 A.',
        'Data sheet, times the gear ratio; or hold a lever against a scale.', ('2.0', '0.8')),
    Key('damping_n_m_s', 'N m s/rad', 'Viscous friction at the joint.',
        'Command a constant current; torque divided by the speed reached.', ('0.5', '0.2')),
    *DRIVE_ENDS)
DC_MOTOR = (
    Key('resistance_ohm', 'ohm', 'Armature resistance R_a.', 'Data sheet, or an ohmmeter.',
        ('1.0', '2.0')),
    Key('torque_constant_n_m_per_a', 'N m/A', 'k_t of the motor, before the gear.', 'Data sheet.',
        ('0.05', '0.03')),
    Key('gear_ratio', '', 'Turns of the motor for one of the joint.', 'Data sheet.',
        ('50', '30')),
    Key('rotor_inertia_kg_m2', 'kg m^2', 'Rotor, tachometer and gear, seen from the motor.',
        'Data sheet.', ('3.0e-5', '2.0e-5')),
    Key('friction_n_m_s', 'N m s/rad', 'Viscous friction, seen from the motor.', 'Data sheet.',
        ('1.0e-5', '1.0e-5'), default='0'),
    Key('amplifier_gain', 'V/V', 'k_p: volts at the motor for a command of 1 V.',
        'Driver manual.', ('20', '20'), default='1'),
    Key('tacho_gain_v_s', 'V s/rad', 'k_tg of the tacho loop, motor side; 0 without a tacho.',
        'Data sheet; 1 V per 1000 rpm is 0.00955.', ('0.05', '0.05'),
        default='0'),
    *DRIVE_ENDS)

KIND = 'velocity_loop (command: speed), current (command: A) or dc_motor (command: V)'
DRIVES = ('drives.shoulder', 'drives.elbow')

KEY_GROUPS = (
    KeyGroup('Name', 'Any text.', ('',), (
        Key('name', '', 'What the arm is called in answers and pictures.', 'Free.',
            ('my_arm',)),)),
    KeyGroup('Links', 'Upper: shoulder to elbow. Lower: elbow to payload.',
             ('links.upper', 'links.lower'), LINK),
    KeyGroup('Drive: velocity loop',
             'The drive turns a command into a joint speed, as most servo drives do.', DRIVES,
             VELOCITY_LOOP, 'velocity_loop', DRIVES),
    KeyGroup('Drive: current', 'The drive turns a command into a motor current, hence a torque.',
             DRIVES, CURRENT, 'current'),
    KeyGroup('Drive: geared DC motor',
             'A motor behind a stiff gear, with or without an analog tacho loop (Appendix A of '
             'the paper).', DRIVES, DC_MOTOR, 'dc_motor'),
    KeyGroup('Elbow', 'What sits at the end of the upper link: motor, gear and housing.',
             ('elbow',), (
                Key('mass_kg', 'kg', 'Mass of it all; not the lower link.', 'Scale.', ('0.5',)),
                Key('inertia_kg_m2', 'kg m^2', 'Its moment of inertia about the elbow axis.',
                    'For a cylinder of radius r: half of its mass times r squared.',
                    ('5.0e-4',)))),
    KeyGroup('Payload', 'What the arm carries when no tool says otherwise.', ('payload',), (
        Key('mass_kg', 'kg', 'Mass at the tip.', 'Scale.', ('0.1',)),
        Key('inertia_kg_m2', 'kg m^2', 'Its moment of inertia about its centre.',
            'Small for a compact body.', ('0.0',), default='0'),
        Key('offset_m', 'm', 'How far its centre is beyond the tip, along the lower link; below 0 '
            'inboard.', 'Ruler: half of a gripper and what it holds.', ('0.0',), default='0'))),
    KeyGroup('Measurement', 'How the sensors are read.', ('measurement',), (
        Key('sample_time_s', 's', 'Time between samples.', 'Setting of the controller.',
            ('0.01',)),
        Key('gauge_amplifier_v_per_strain', 'V per unit strain',
            'Only scales the noise r_2 of SF1, which the paper states in volts.',
            'Amplifier manual; logs hold strain, not volts.', ('2000',),
            default='1'),
        Key('angle_noise_rad', 'rad', 'Standard deviation of a joint angle at rest.',
            'Log the arm at rest; for an encoder, its step divided by 3.5, or its step where '
            'readings repeat while the joint moves: such errors go with the motion.',
            ('2.0e-4',)),
        Key('strain_noise', 'm/m', 'Standard deviation of a strain at rest.',
            'Log the arm at rest.', ('5.0e-7',)))),
)

TOLERANCES_ABOUT = (
    'How far the arm may be from the numbers above: standard deviations, relative unless a unit '
    'is named. `flex_robot prior` lists the parts that they belong to, '
    'and how large effects may be on the robot. Too small a tolerance '
    'makes the tools blame something else; `flex_robot calibrate` shrinks what a log can tell.')

# Default tolerance in the template, for an arm that has not been calibrated, and what it is of.
TOLERANCES: dict[str, tuple[float, str]] = {
    'stiffness': (0.1, "Young's modulus of each link; the cube of the thickness is in it."),
    'damping': (0.5, 'Damping ratio of each link.'),
    'link_mass': (0.05, 'Density of each link.'),
    'drive_inertia': (0.1, 'Inertia of each drive.'),
    'drive_gain': (0.1, 'Gain or torque constant of each drive.'),
    'drive_damping': (0.2, 'Damping of each drive; the time constant of a velocity loop.'),
    'elbow_mass': (0.05, 'Mass at the elbow.'),
    'elbow_inertia': (0.2, 'Inertia at the elbow.'),
    'strain_gain': (0.1, 'Scale of each gauge: gauge factor, amplifier, glue.'),
    'payload': (0.01, 'The payload that one tells the tools.'),
    'length': (0.005, 'Length of each link.'),
    'gauge_position_m': (0.001, 'Place of each gauge, m.'),
    'strain_bias': (2e-5, 'Zero of each gauge, m/m.'),
    # A degree, as by eye along two links; the default of a file, 0.005, is 2 mm at 0.35 m.
    'angle_zero_rad': (0.02, "Zero of joint 2's angle: it reads 0 with both links in line, rad."),
    'payload_inertia_kg_m2': (2e-4, 'Inertia of the payload about its centre, kg m^2.'),
}

EFFECTS_ABOUT = (
    'What the arm has beyond links and drives: friction, backlash, gauge scale and zero, … A list '
    'of `name`, `site` and the parameters of the [catalogue of effects](effects.md). '
    '`flex_diagnose --extended` and `flex_robot calibrate` write it.')
