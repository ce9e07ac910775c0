"""The files that answer a newcomer's questions exist, at most three for each."""

import re
from pathlib import Path

HOUSE = Path(__file__).parents[2]
ROWS = re.findall(r"^\| ([^|]+\?) \| ([^|]+) \|$", Path(__file__).with_name("questions.md").read_text("utf-8"), re.MULTILINE)
MOST_FILES = 3


def test_there_are_at_least_twenty_questions() -> None:
    assert len({question for question, _ in ROWS}) >= 20


def test_every_question_is_answered_by_at_most_three_files_that_exist() -> None:
    wrong = []
    for question, cell in ROWS:
        files = re.findall(r"`([^`]+)`", cell)
        if not 1 <= len(files) <= MOST_FILES or not all((HOUSE / file).is_file() for file in files):
            wrong.append((question, files))
    assert wrong == []
