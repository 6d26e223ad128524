"""Run sweeps that each answer a question; see aerokernels/validation/questions.py."""

import argparse
from pathlib import Path
from typing import Any

from aerokernels.validation.questions import QUESTIONS, QUICK
from aerokernels.validation.report import filled

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "questions.md"


def main() -> None:
    """Run the sweeps, and write text and picture of each answer."""
    parser = argparse.ArgumentParser(prog="scripts/questions", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(QUESTIONS)} [all of them]")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "questions", help="folder of what is written")
    parser.add_argument("--page", action="store_true", help="put the texts into docs/questions.md too")
    parser.add_argument("--quick", action="store_true", help="few rays and a coarse grid, to see how it goes")
    options = parser.parse_args()
    names = options.names or list(QUESTIONS)
    for name in names:
        if name not in QUESTIONS:
            parser.error(f"{name!r} is no question: choose among {', '.join(QUESTIONS)}")
    try:
        if options.page:  # fail before the work, not after it
            filled(PAGE, dict.fromkeys(names, ""))
    except ValueError as fault:
        parser.error(str(fault))
    options.out.mkdir(parents=True, exist_ok=True)
    for name in names:
        given: dict[str, Any] = {}
        if options.quick:
            given = {"ray_count": 512} if name == "look-angle" else {"settings": QUICK}
        answer = QUESTIONS[name](**given)
        (options.out / f"{name}.md").write_text(answer.text, encoding="utf-8")
        answer.save(options.out / f"{name}.png")
        if options.page:
            PAGE.write_text(filled(PAGE, {name: answer.text}), encoding="utf-8")
        print(f"{name}\n{answer.text}", flush=True)
    print(f"wrote {', '.join(f'{name}.md and {name}.png' for name in names)} to {options.out}")


if __name__ == "__main__":
    main()
