"""Read a log of any kind."""

from collections.abc import Callable, Mapping
from pathlib import Path

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs import hdf5, json_log, matlab, numpy_archive, ros, text
from analysis.closeloop.logs.log import A_PICKLE, Log

#: What reads a file, by its ending.
READERS: Mapping[str, Callable[[Path], Log]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".log", ".asc", ".sto", ".mot"), text.read),
    ".mat": matlab.read,
    ".npz": numpy_archive.read,
    ".npy": numpy_archive.read_array,
    ".json": json_log.read,
    **dict.fromkeys((".h5", ".hdf5"), hdf5.read),
    **dict.fromkeys((".bag", ".mcap", ".db3"), ros.read),
}
#: Python's pickles, which run whatever code is in them when they are read.
PICKLES = (".pkl", ".pickle", ".joblib")


def read_log(path: Path) -> Log:
    """Read a log; its ending, or a `metadata.yaml` in a folder, says how.

    Raises:
        SessionError: the file is not there, is of no known kind, or is damaged.
        ModuleNotFoundError: the kind needs a package of the extra `logs`.
    """
    if not path.exists():
        raise SessionError("does not exist", file=str(path))
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise SessionError(
                "is a folder without the metadata.yaml of a ROS 2 bag: give its .db3 or .mcap",
                file=path.name,
            )
        reader: Callable[[Path], Log] | None = ros.read
    elif not path.is_file():
        raise SessionError("is no file", file=path.name)
    else:
        reader = READERS.get(path.suffix.lower())
    if path.suffix.lower() in PICKLES:
        raise SessionError(A_PICKLE, file=path.name)
    if reader is None:
        raise SessionError(f"ends in none of {', '.join(READERS)}", file=path.name)
    try:
        log = reader(path)
    except (SessionError, ModuleNotFoundError):
        raise
    except OSError as error:
        raise SessionError(f"cannot be read: {error.strerror or error}", file=path.name) from None
    except Exception as error:  # a damaged file may trip its reader anywhere
        why = " ".join(f"{type(error).__name__} {error}".split())[:200]
        raise SessionError(f"is damaged, or of a kind not known: {why}", file=path.name) from None
    if not log.channels:
        why = "; ".join(["holds no signal: no column of two or more numbers", *log.remarks])
        raise SessionError(why, file=path.name)
    return log
