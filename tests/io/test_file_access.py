"""Opening what others wrote."""

import sys

import numpy as np
import pytest

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import check_within, is_plain, limited_memory, number, read_bytes, read_text


def test_text_comes_without_mark_and_with_one_kind_of_line_end(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfone\r\ntwo\rthr\xc3\xa9e\n")
    assert read_text(tmp_path / "a", "") == "one\ntwo\nthrée\n"


def test_a_file_may_be_as_large_as_allowed_and_not_a_byte_more(tmp_path):
    (tmp_path / "a").write_bytes(bytes(5_000_000))
    assert len(read_bytes(tmp_path / "a", "cure", 5_000_000)) == 5_000_000
    with pytest.raises(InputError, match=r"a: has 5 MB, 5 MB is the most; cure"):
        read_bytes(tmp_path / "a", "cure", 4_999_999)


def test_a_folder_is_left_by_names_and_by_links(tmp_path):
    folder = tmp_path / "case"
    (folder / "bones").mkdir(parents=True)
    (folder / "out").symlink_to(tmp_path)
    (tmp_path / "link").symlink_to(folder)
    check_within(tmp_path / "link", folder / "bones" / ".." / "a")
    check_within(folder, tmp_path / "link" / "a")
    for outside in ("../a", "out/a", "bones/../../case2/a", "/a"):
        with pytest.raises(InputError, match="lies outside the case folder"):
            check_within(folder, folder / outside)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds the limit")
def test_a_library_that_asks_for_too_much_is_stopped_and_the_limit_taken_back():
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    with pytest.raises(MemoryError), limited_memory(1000):
        np.ones(2**30)  # 8 GiB
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    with limited_memory(1000):
        assert np.ones(2**24).sum() == 2**24


def test_numbers_and_names_are_what_they_look_like():
    assert number("-1.5e2") == -150.0
    for text in ("1_000", "", "0x10", "1,5"):
        with pytest.raises(ValueError, match="could not convert"):
            number(text)
    assert is_plain("T7 – μ")
    assert not any(is_plain(name) for name in ("a\nb", "a\x00", "\ud800", "a\u2028b"))
