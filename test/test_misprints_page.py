"""The page of misprints names tests that exist, and every test's misprint is on the page."""

from __future__ import annotations

from pathlib import Path
import re


def test_the_page_and_the_tests_agree(repository: Path) -> None:
    page = (repository / 'docs' / 'misprints.md').read_text(encoding='utf-8')
    named = re.findall(r'`(test/\w+\.py)::(\w+)`', page)
    assert len(named) > 20
    for file, test in named:
        assert f'def {test}(' in (repository / file).read_text(encoding='utf-8'), test
    sections = {int(number) for number in re.findall(r'^## (\d+)\.', page, re.MULTILINE)}
    assert sections == set(range(1, 18))
    for section in re.split(r'^## ', page, flags=re.MULTILINE)[1:]:
        assert '`test/' in section, section.splitlines()[0]
