"""Inputs that atheris (where it is installed) guides by the code they reach: `python fuzz_guided.py -runs=9999 CORPUS`.

In addition to the corrupted files of `fuzz_files` this explores the readers of text: the first byte of an input
selects the reader, the others are the file. The folder CORPUS is first filled with valid files. A violated rule ends
the run.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["nlosctl"]):
    import nlosctl.formats.fields
    import nlosctl.formats.kraken_csv
    import nlosctl.formats.kraken_xml
    import nlosctl.formats.uudf
    import nlosctl.formats.uwb
    import nlosctl.io.readers.csv_records
    import nlosctl.io.readers.json_lines
    import nlosctl.io.scenes.scene_file  # noqa: F401 - imported to be instrumented

from fuzz_words import words_of
from guarded_run import complaints, run_guarded
from other_seeds import other_seeds
from seed_files import SeedFile, table_seeds


def readable_seeds() -> list[SeedFile]:
    """Return the valid text files, one of each target, kind and extension."""
    files = [file for file in (*table_seeds(), *other_seeds()) if file.target in ("csv", "jsonl", "scene", "import")]
    texts = [file for file in files if Path(file.name).suffix not in (".npz", ".parquet", ".gz")]
    return list({(file.target, file.kind, file.name): file for file in texts}.values())


SEEDS = readable_seeds()


def check_one(data: bytes) -> None:
    """Run the job of the reader that the first byte selects on the other bytes; raise if a rule is violated."""
    if not data:
        return
    file = SEEDS[data[0] % len(SEEDS)]
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        for other, content in ((file.name, data[1:]), *file.beside):
            Path(other).write_bytes(content)
        before = [path.name for path in Path(name).iterdir()]
        words, outputs = words_of(file, _Plain())
        wrong = list(complaints(run_guarded(words), Path(name), outputs, before))
        os.chdir("/")
    if wrong:
        raise AssertionError(f"{' '.join(words)}: {wrong}")


class _Plain(random.Random):
    """Random choices that always select the default."""

    def random(self) -> float:
        return 0.5


def main() -> None:
    """Fill the corpus and run."""
    folders = [Path(word) for word in sys.argv[1:] if not word.startswith("-")]
    for folder in folders[:1]:
        folder.mkdir(exist_ok=True)
        for number, file in enumerate(SEEDS):
            (folder / f"{number}-{file.kind}").write_bytes(bytes([number]) + file.content)
    atheris.Setup(sys.argv, check_one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
