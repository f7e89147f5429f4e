"""The site: built without a warning, and what it says of statuses and verdicts is complete."""

from __future__ import annotations

from pathlib import Path
import re
import subprocess
import sys

from flex_payload_estimator.nodes.payload_estimator_node import MESSAGES
from flex_plant_sim.diagnosis.verdict.results import VERDICTS
from msg_config.contract import load_topics
import pytest


@pytest.mark.slow
def test_the_site_builds_without_a_warning(repository: Path, tmp_path: Path) -> None:
    pytest.importorskip('sphinx', reason="needs the extra docs: pip install 'flex_payload[docs]'")
    result = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-b', 'html', '-W', '--keep-going', '-q', '-d',
         str(tmp_path / 'cache'), str(repository / 'docs'), str(tmp_path / 'site')],
        text=True, capture_output=True)
    assert result.returncode == 0, result.stderr
    pages = {path.stem for path in (repository / 'docs').glob('*.md')}
    assert {path.stem for path in (tmp_path / 'site').glob('*.html')} >= pages


def test_every_page_is_in_the_table_of_contents(repository: Path) -> None:
    index = (repository / 'docs/index.md').read_text(encoding='utf-8')
    listed = {line for block in re.findall(r'```{toctree}\n(.*?)```', index, re.S)
              for line in block.splitlines()}
    pages = {path.stem for path in (repository / 'docs').glob('*.md')} - {'index'}
    assert pages <= listed


def test_every_status_and_verdict_is_explained(repository: Path) -> None:
    page = (repository / 'docs/report.md').read_text(encoding='utf-8')
    for name in (*MESSAGES, *VERDICTS):
        assert f'| `{name}` |' in page, name


def test_every_module_is_on_the_map(repository: Path) -> None:
    page = (repository / 'docs/architecture.md').read_text(encoding='utf-8')
    families = {'drive', 'joint', 'payload', 'sensor', 'structure'}
    modules = {path.name for package in ('flex_plant_sim', 'flex_payload_estimator', 'msg_config')
               for path in (repository / package).rglob('*.py')
               if path.parent.name not in families}
    assert not [name for name in sorted(modules) if name not in page]
    named = {name for text in re.findall(r'`([^`]+)`', page)
             for name in re.findall(r'\w+\.py', text)}
    present = {path.name for path in repository.rglob('*.py') if '.venv' not in path.parts}
    assert named <= present


def test_every_link_of_the_readme_leads_somewhere(repository: Path) -> None:
    text = (repository / 'README.md').read_text(encoding='utf-8')
    for target in re.findall(r'\]\(([^)#]+)\)', text):
        assert (repository / target).is_file(), target


def test_the_recorded_topics_of_the_docs_exist(repository: Path) -> None:
    text = (repository / 'docs/logs.md').read_text(encoding='utf-8')
    recorded = re.findall(r'ros2 bag record .*', text)
    assert recorded
    topics = {name.strip('/') for name in load_topics()}
    for line in recorded:
        assert set(re.findall(r' /(\S+)', line)) <= topics
