"""
How many samples count as one: the temper at which stated probabilities are most honest.

Calibration cases of the bank (both simulators, forms that may be tuned on, seeds that never score)
are searched once; every set of causes that was fitted is kept as its moments, from which evidence
follows at any temper without another pass. Printed per temper: the mean log-score of a case, its
paired gain over the first one's, the calibration error, and cases answered surely and wrongly.

    python benchmarks/temper.py --count 40 --keep build/temper
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import pickle
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from bank import score  # noqa: E402
from bank.cases import all_cases, BankCase  # noqa: E402
from bank.records import write_record  # noqa: E402
from bank.sizes import read_limits, sized_truth  # noqa: E402
from bank.summary import JUDGED  # noqa: E402
from flex_plant_sim.arm.robot_file import load_robot  # noqa: E402
from flex_plant_sim.diagnosis.causes.fit import Fit  # noqa: E402
from flex_plant_sim.diagnosis.causes.posterior import is_unknown, Key, Posterior  # noqa: E402
from flex_plant_sim.diagnosis.causes.search import search  # noqa: E402
from flex_plant_sim.diagnosis.likelihood.moments import TEMPER  # noqa: E402
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude  # noqa: E402
from flex_plant_sim.diagnosis.prediction.predictor import Base  # noqa: E402
from flex_plant_sim.diagnosis.record.data import Data  # noqa: E402
from flex_plant_sim.diagnosis.record.windows import Record  # noqa: E402
from flex_plant_sim.diagnosis.verdict.verdict import (  # noqa: E402
    causes_of,
    nominal_base,
    slowest_frequency,
)
from flex_plant_sim.logs.read import read_log  # noqa: E402
import numpy as np  # noqa: E402

TEMPERS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
ROBOT = load_robot('reference')


def chosen_cases(count: int) -> list[BankCase]:
    """Return the first calibration cases that a search answers and the score judges."""
    return [case for case in all_cases('calibration', 9)
            if case.kind in JUDGED and case.robot == 'reference'][:count]


def base_of(case: BankCase) -> Base:
    """Return the nominal model that a case is asked about."""
    model, modes = ('paper', 1) if '--model' in case.options else ('assumed_modes', 3)
    return nominal_base(ROBOT, model, modes, '--no-coriolis' not in case.options)


def searched(case: BankCase, amplitude: Amplitude) -> dict[str, Any]:
    """Return what a search of a case went through, and what is hidden."""
    truth, terms = sized_truth(case, read_limits()['reference'])
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'record.csv'
        write_record(case, truth, path)
        log = read_log(path, ROBOT)
    base = replace(base_of(case), discrepancy=amplitude)
    record = Record('record', log.time - log.time[0], log.command, log.output, truth.payload_told)
    data = Data.of([record], slowest_frequency(base, record.payload), ROBOT.sample_time)
    started = time.process_time()
    with np.errstate(all='ignore'):
        found = search(data, base, 1, lambda step, share: None, [
            option.partition('=')[2] for option in case.options if '--exclude' in option])
    return {'line': {'key': case.key, 'kind': case.kind, 'names': list(case.names),
                     'form': case.realisation.form, 'distractors': [
                         name for name in truth.names if name not in case.names]},
            'terms': terms, 'fits': found.posterior.fits,
            'nominal': found.posterior.nominal,
            'cpu': time.process_time() - started}


def at_temper(fit: Fit, temper: float) -> Fit:
    """Return a fit as it would have been weighed at a temper."""
    scale = fit.moments.scaled(temper)
    return replace(fit, scale=scale, covariance=fit.moments.joined(scale, temper).covariance,
                   log_evidence=fit.moments.log_evidence(scale, temper))


def line_at(kept: dict[str, Any], temper: float) -> dict[str, Any]:
    """Return a case's answer at a temper as the bank scores it."""
    base = kept['nominal']
    posterior = Posterior.of([at_temper(fit, temper) for fit in kept['fits']], base)
    causes = [{'name': c.name, 'probability': c.probability, 'look_alikes': c.look_alikes}
              for c in causes_of(posterior, posterior.best)]
    unknown = is_unknown(posterior.best, base)
    verdict = ('cause_and_remainder' if causes else 'not_in_catalogue') if unknown else (
        'nothing_wrong' if not causes else
        'cannot_tell' if any(c['look_alikes'] for c in causes) else 'cause')
    return {**kept['line'], 'verdict': verdict, 'causes': causes, 'sets': [
        {'causes': sorted(Key.of(fit).labels), 'probability': float(p)}
        for fit, p in zip(posterior.fits, posterior.probability)]}


def table(kept: Sequence[dict[str, Any]]) -> None:
    """Print one row a temper."""
    print('temper  log-score (+- of the mean)   gain on the first   calibration  surely wrong')
    first: list[float] = []
    for temper in TEMPERS:
        lines = [line_at(item, temper) for item in kept]
        scores = [score.log_score(line) for line in lines]
        first = first or scores
        gains, root = np.subtract(scores, first), np.sqrt(len(scores))
        wrong = sum(map(score.surely_wrong, lines))
        error = score.calibration(score.stated_probabilities(lines))[0]
        print(f'{temper:6.0f}  {np.mean(scores):9.2f} +- {np.std(scores) / root:5.2f}   '
              f'{np.mean(gains):+9.2f} +- {np.std(gains) / root:5.2f}   {error:11.3f}  {wrong:4d}',
              flush=True)


def main() -> None:
    """Search what is not kept yet; print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--count', type=int, default=40, help='cases (default: 40)')
    parser.add_argument('--keep', type=Path, default=Path('build/temper'), help='folder')
    parser.add_argument('--torque', type=float, default=Amplitude().torque)
    parser.add_argument('--gauge', type=float, default=Amplitude().gauge)
    chosen = parser.parse_args()
    chosen.keep.mkdir(parents=True, exist_ok=True)
    kept = []
    for case in chosen_cases(chosen.count):
        path = chosen.keep / f'{case.seed}.pickle'
        if not path.exists():
            path.write_bytes(pickle.dumps(searched(
                case, Amplitude(torque=chosen.torque, gauge=chosen.gauge))))
        kept.append(pickle.loads(path.read_bytes()))
        line = line_at(kept[-1], TEMPER)
        print(f'{case.key:<70} {kept[-1]["cpu"]:5.1f} s  {line["verdict"]:<18} ' + ', '.join(
            f'{c["name"]} {c["probability"]:.2f}' for c in line['causes']), flush=True)
    print(f'CPU: median {np.median([item["cpu"] for item in kept]):.1f} s, '
          f'longest {max(item["cpu"] for item in kept):.1f} s')
    table(kept)


if __name__ == '__main__':
    main()
