"""The site: built without a warning, and what it says of statuses and verdicts is complete."""

from __future__ import annotations

from pathlib import Path
import re
import subprocess
import sys
from typing import get_args

from flex_payload_estimator.nodes.payload_estimator_node import MESSAGES
from flex_plant_sim.diagnosis.verdict.results import Verdict
from msg_config.contract import load_topics
import pytest

PACKAGES = ('flex_plant_sim', 'flex_payload_estimator', 'msg_config')


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
    for name in (*MESSAGES, *get_args(Verdict)):
        assert f'| `{name}` |' in page, name


def _modules(repository: Path, *folders: str) -> list[str]:
    return [path.relative_to(repository).as_posix()
            for folder in folders for path in (repository / folder).rglob('*.py')]


def _on_the_map(page: str, modules: list[str]) -> set[str]:
    """
    Return the modules that the tables of a page name.

    A name that several modules have stands for those in the folders that its row, the row that
    opens its section, or the head of its table names.
    """
    found, head, section, table = set(), set[str](), set[str](), False
    for line in page.splitlines():
        folders = set(re.findall(r'(\w[\w/]*)/', line))
        if line.startswith('|') and not table:
            head, section = folders, set()
        table = line.startswith('|')
        section = set(re.findall(r'\*\*(\w+)/\*\*', line)) or section
        for name in re.findall(r'\w[\w/]*\.py', line) if table else ():
            there = {path for path in modules if f'/{path}'.endswith(f'/{name}')}
            assert there, f'no module {name}'
            found |= there if len(there) == 1 else {
                path for path in there for folder in head | section | folders
                if path.rpartition('/')[0].endswith(folder)}
    return found


def test_every_module_is_on_the_map(repository: Path) -> None:
    page = (repository / 'docs/architecture.md').read_text(encoding='utf-8')
    page = page[:page.index('| tests and measurements |')]
    modules = _modules(repository, *PACKAGES)
    one_effect = re.compile('flex_plant_sim/effects/(drive|joint|payload|sensor|structure)/')
    wanted = {path for path in modules
              if not path.endswith('__init__.py') and not one_effect.match(path)}
    assert sorted(wanted - _on_the_map(page, modules)) == []


def test_what_is_said_to_be_in_a_module_is_there(repository: Path) -> None:
    """Documents say `name` in `folder/module.py`."""
    modules, said = _modules(repository, *PACKAGES, 'test', 'benchmarks'), []
    for page in sorted((repository / 'docs').glob('*.md')):
        said += re.findall(r'`(\w+)`\s+in\s+`([\w/]+\.py)`', page.read_text(encoding='utf-8'))
    assert said
    for name, module in said:
        here = re.compile(rf'^ *(def |class |){name}\b', re.MULTILINE)
        assert any(here.search((repository / path).read_text(encoding='utf-8'))
                   for path in modules if f'/{path}'.endswith(f'/{module}')), (name, module)


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
