"""Files that appear whole or not at all: written beside their place under another name, then renamed."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing_file(target: Path, suffix: str = "") -> Iterator[Path]:
    """Give a file to write, which takes the target's place when the block ends well.

    Args:
        target: path of the file; an old file there stays until the new one is whole. Its folder is made.
        suffix: ending of the temporary name, for writers that look at it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=target.name, suffix=f".part{suffix}")
    os.close(handle)
    try:
        yield Path(name)
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise


@contextmanager
def replacing_folder(target: Path) -> Iterator[Path]:
    """Give a folder to fill, which takes the target's place when the block ends well.

    Args:
        target: path of the folder; an old folder there is deleted with all that is in it.
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
    """The permission bits that new files of this process do not get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
