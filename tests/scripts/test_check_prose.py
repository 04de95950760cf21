"""The check of English finds what it is to find, where it is, and leaves code alone."""

import check_prose
import pytest


def test_offence_is_found_with_its_line_and_a_better_word() -> None:
    assert check_prose.offences("fine\nit tells us") == [(2, "'tells': write report, state, show or distinguish")]


def test_rule_of_proselint_is_applied() -> None:
    assert check_prose.offences("the first of all reasons")


@pytest.mark.parametrize("text", ["a teller stands steadfast", "`tell` is a name", ""])
def test_harmless_text_passes(text: str) -> None:
    assert check_prose.offences(text) == []


def test_docstrings_comments_and_messages_of_code_are_read_where_they_are() -> None:
    code = (
        'def f():\n    """One.\n\n    It tells all of it."""\n    raise E("nobody was there")  # hangs on that\n'
    )
    assert [line for line, _ in check_prose.offences(check_prose.of_code(code))] == [4, 5, 5]


def test_code_and_addresses_of_a_page_are_left_out() -> None:
    page = "a\n```sh\ntell me\n```\n[b](told.md)\n$$\nanew\n$$\nforetold"
    assert [line for line, _ in check_prose.offences(check_prose.of_page(page))] == [9]


def test_tags_and_expressions_of_a_template_are_left_out() -> None:
    assert check_prose.of_template("<p title='tell'>\n{{ told }} fine</p>").split() == ["fine"]


def test_docstring_that_begins_with_a_noun_clause_is_found() -> None:
    code = 'x = 1\n"""What it is."""\ny = "What is this?"\n'
    assert [line for line, _ in check_prose.noun_clauses(code)] == [2]


def test_a_name_that_states_nothing_is_found_wherever_it_is_given() -> None:
    code = (
        "def f(given, *others):\n    found = [one for one in given]\n    self._kept = found\n    return found\n"
        "class Known:\n    there: int = 0\n"
        "heights = [level.one for level in levels(known=True)]\n_STEP = LEAST_VOXELS = 2.0\n"
    )
    assert [line for line, _ in check_prose.empty_names(code)] == [5, 8, 1, 1, 2, 3, 6, 2]
