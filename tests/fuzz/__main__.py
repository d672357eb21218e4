"""``python -m tests.fuzz``: a campaign of any length, or one input again."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.fuzz.campaign import attempt, campaign


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--number", type=int, default=2000, help="of inputs")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"), help="folder for inputs that fail")
    parser.add_argument("--seed", type=int, help="read the input of this seed again, with its traceback")
    given = parser.parse_args()
    if given.seed is not None:
        again(given.seed)
        return
    found = campaign(range(given.first, given.first + given.number), given.workers, given.keep, tell=True)
    for (target, fault, where), count in Counter((f.target, f.fault, f.where) for f in found).most_common():
        print(f"{count:6d} {target}: {fault} at {where}")
    print(f"{given.number} inputs, {len(found)} findings" + (f", kept in {given.keep}" if found else ""))
    sys.exit(bool(found))


def again(seed: int) -> None:
    """One input, whose traceback is not caught."""
    from tests.fuzz.targets import chosen

    with tempfile.TemporaryDirectory() as folder:
        print(*attempt(seed, Path(folder)))
    with tempfile.TemporaryDirectory() as folder:
        target, rng = chosen(seed)
        path = target.write(rng, Path(folder))
        print(target.name, path)
        target.read(path)


if __name__ == "__main__":
    main()
