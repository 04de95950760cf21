"""The check of English finds words and names that are refused, where they are, and leaves code alone."""

import check_prose


def test_words_and_names_that_are_refused_are_found_in_their_lines() -> None:
    code = 'def f(given):\n    """One.\n\n    It tells all."""\n    raise E("nobody was there")  # hangs on that\n'
    assert [line for line, _ in check_prose.offences(check_prose.of_code(code))] == [4, 5, 5]
    assert [line for line, _ in check_prose.empty_names(code)] == [1]
    page = "a teller\n```sh\ntell me\n```\n[b](told.md), `tell`\n$$\nanew\n$$\nforetold"
    assert [line for line, _ in check_prose.offences(check_prose.of_page(page))] == [9]
    assert check_prose.of_template("<p title='tell'>\n{{ told }} fine</p>").split() == ["fine"]
