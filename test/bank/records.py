"""Writes the log file of a case: of the true arm, or of a negative control."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bank.cases import BankCase
import numpy as np
from truth.records import draw_case, make_record, Record, TruthCase

SHUFFLED = ('link_stiffness', 'strain_gain', 'modal_damping', 'strain_crosstalk')


def write_record(case: BankCase, truth: TruthCase, path: Path) -> None:
    """Write the case's log as CSV."""
    record = control(case) if case.kind == 'control' else make_record(truth)
    record.write_csv(path)


def control(case: BankCase) -> Record:
    """Return the record of a negative control, in which no effect of the catalogue is hidden."""
    clean = draw_case(None, case.seed, case.robot)
    record = make_record(clean)
    rng = np.random.default_rng([case.seed, 7])
    if case.names == ('noise_only',):
        spread = 1e-4 * rng.standard_normal(record.joint.shape)
        return replace(record, command=0.0 * record.command, joint=spread,
                       strain=5e-7 * rng.standard_normal(record.strain.shape))
    if case.names == ('swapped_strain_labels',):
        order = [2, 1, 0, 3] if record.strain.shape[1] == 4 else [1, 0]
        return replace(record, strain=record.strain[:, order])
    if case.names == ('swapped_joint_labels',):
        return replace(record, joint=record.joint[:, ::-1])
    return shuffled(case, clean, record, rng)


def shuffled(case: BankCase, clean: TruthCase, record: Record,
             rng: np.random.Generator) -> Record:
    """Return the clean record plus an effect's contribution to its strain, in random order."""
    name = SHUFFLED[case.seed % len(SHUFFLED)]
    effect = draw_case(name, case.seed, case.robot)
    hidden = make_record(replace(clean, effects=effect.effects), record.command)
    added = hidden.strain - record.strain
    return replace(record, strain=record.strain + rng.permutation(added))
