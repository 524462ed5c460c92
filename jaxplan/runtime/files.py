"""Writing files completely or not at all: under a temporary name beside the target, then renamed."""

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing_file(target: Path, suffix: str = "", *, private: bool = False) -> Iterator[Path]:
    """Yield the path of a temporary file to write; it replaces the target if the block ends without error.

    Args:
        target: path of the file; an existing file stays until then. Its folder is created.
        suffix: ending of the temporary name, for writers that depend on it.
        private: whether the file is for this user alone, instead of with the rights of the user's files.

    Raises:
        IsADirectoryError: if the target is a folder.
    """
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder, name a file in it", str(target))
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=target.name, suffix=f".part{suffix}")
    os.close(handle)
    try:
        yield Path(name)
        if not private:
            os.chmod(name, 0o666 & ~_umask())
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise


@contextmanager
def replacing_folder(target: Path) -> Iterator[Path]:
    """Yield the path of an empty folder to fill; it replaces the target if the with block ends without error.

    Args:
        target: path of the folder; an existing folder is then deleted with all that is in it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=target.name, suffix=".part") as holder:
        fresh, old = Path(holder) / "new", Path(holder) / "old"
        fresh.mkdir()  # unlike its holder, with the rights that the user's folders have
        yield fresh
        if target.exists():
            os.rename(target, old)
        try:
            os.rename(fresh, target)
        except BaseException:
            if old.exists():
                os.rename(old, target)
            raise


def _umask() -> int:
    """Return the permission bits that new files of this process do not get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
