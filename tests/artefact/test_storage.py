"""Storage with an address: files that appear whole, and one line for what it refuses."""

import errno

import fsspec
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from urbantwin.artefact.storage import Storage, is_url
from urbantwin.errors import InputError, StageError


class LimitedFileSystem(MemoryFileSystem):
    """Memory that takes so many bytes, and then does what a disk or a service does."""

    protocol = "limited"
    store: dict = {}  # noqa: RUF012 - fsspec has it so
    pseudo_dirs = [""]  # noqa: RUF012
    left = 0
    error: Exception = OSError(errno.ENOSPC, "No space left on device")

    def pipe_file(self, path, value, mode="overwrite", **options):
        if len(value) > type(self).left:
            raise type(self).error
        type(self).left -= len(value)
        super().pipe_file(path, value, mode, **options)


@pytest.fixture
def limited():
    fsspec.register_implementation("limited", LimitedFileSystem, clobber=True)
    LimitedFileSystem.store.clear()
    LimitedFileSystem.left = 10
    LimitedFileSystem.error = OSError(errno.ENOSPC, "No space left on device")
    return LimitedFileSystem


@pytest.mark.parametrize(
    ("given", "expected"),
    [("s3://a/b", True), ("file:///a", True), ("out/a", False), ("C://", False), ("://a", False)],
)
def test_what_is_an_address(given, expected):
    assert is_url(given) is expected


@pytest.mark.parametrize("scheme", ["memory", "file"])
def test_what_is_written_is_read(scheme, tmp_path):
    place = Storage.of(f"{scheme}://{tmp_path}/of/") / "this"
    assert place.names() == []
    place.write("a/b.bin", b"12", memoryview(b"34"))
    place.write("c.bin", b"")
    assert place.names() == ["a/b.bin", "c.bin"]
    assert place.read("a/b.bin") == b"1234"
    assert place.read_all(["a/b.bin", "c.bin"]) == {"a/b.bin": b"1234", "c.bin": b""}
    with pytest.raises(InputError, match=r"b.txt: is not there"):
        place.read("b.txt")
    place.remove()
    assert place.names() == []


def test_another_run_may_have_moved_the_same_file(limited, monkeypatch):
    def moved_before(system, source, target, **options):
        system.pipe_file(target, system.cat_file(source))
        raise FileNotFoundError(source)

    monkeypatch.setattr(LimitedFileSystem, "mv", moved_before)
    place = Storage.of("limited://a")
    place.write("b", b"1234")
    assert place.read("b") == b"1234"


def test_a_full_one_is_told_with_what_to_do(limited):
    place = Storage.of("limited://a")
    place.write("b", b"12345")
    with pytest.raises(StageError, match="limited://a/c: there is no room left; give the same"):
        place.write("c", b"1234567")
    assert place.names() == ["b"]


@pytest.mark.parametrize(
    ("raised", "kind", "said"),
    [
        (OSError(errno.EROFS, "Read-only file system"), InputError, "limited://a/c: is read-only"),
        (PermissionError("Access Denied\nat once"), InputError, "is refused (Access Denied)"),
        (type("NoCredentialsError", (Exception,), {})("none"), InputError, "expected credentials"),
        (RuntimeError("the service\nis away"), StageError, "the service; give the same command"),
    ],
)
def test_what_a_library_says_is_one_line(limited, raised, kind, said):
    limited.error = raised
    with pytest.raises(kind) as found:
        Storage.of("limited://a").write("c", b"1234567891011")
    assert said in str(found.value)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("url", ["file:///", "s3:///", "s3://a/b*", "file:///a[1]/b"])
def test_an_address_that_names_no_place_is_refused(url):
    with pytest.raises(InputError, match="names no place; expected an address like"):
        Storage.of(url)


def test_a_name_that_no_bucket_can_have_is_told_with_what_is_wrong(limited):
    limited.error = type("ParamValidationError", (Exception,), {})("validation failed:\nbad name\n")
    with pytest.raises(InputError, match="limited://a/c: validation failed: bad name; expected"):
        Storage.of("limited://a").write("c", b"1234567891011")


def test_a_bucket_that_is_missing_is_named_and_not_the_file(limited):
    class Buckets(LimitedFileSystem):
        protocol = "oss"

        @classmethod
        def _strip_protocol(cls, path):
            return path.removeprefix("oss://")

    fsspec.register_implementation("oss", Buckets, clobber=True)
    Buckets.error = FileNotFoundError("The specified bucket does not exist")
    with pytest.raises(
        InputError, match=r"^oss://absent: is not there; expected a bucket"
    ) as found:
        Storage.of("oss://absent/data/set").write("points/000001.npy", b"1234567891011")
    assert "points" not in str(found.value)


def test_an_address_that_nothing_reaches_is_refused():
    with pytest.raises(InputError, match=r"nobody://a.*nobody"):
        Storage.of("nobody://a")
    with pytest.raises(StageError, match=r"ftp://me:\*\*\*@localhost:1/a: .*refused") as raised:
        Storage.of("ftp://me:secret@localhost:1/a")
    assert "secret" not in str(raised.value)
