"""The table in docs/files.md of what files state: made from the tests that are marked with `states`.

    @pytest.mark.states("Movies", "a display matrix of another angle than quarters of a circle", "refused")

`python tests/helpers/stated_table.py` writes it anew; tests/test_documents.py compares it.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "files.md"
BEGIN, END = "<!-- from the tests: begin -->", "<!-- from the tests: end -->"
KINDS = ("Stills", "Environments", "Movies", "USD", "glTF", "Lights files", "Analysis caches")
# What a test of each verdict has in its body; the words of a verdict are those of the table.
CALLS = {
    "honoured": (),
    "warned of": ("warns(",),
    "refused": ("raises(", "check_refused(", "first_line(", "refused ="),
}


def rows():
    """Yield (kind, what, verdict, test) of each mark, checked against the test's body."""
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        source = path.read_text(encoding="utf-8")
        if "mark.states" not in source:
            continue
        for function in ast.walk(ast.parse(source)):
            if not isinstance(function, ast.FunctionDef):
                continue
            for mark in function.decorator_list:
                if isinstance(mark, ast.Call) and ast.unparse(mark.func) == "pytest.mark.states":
                    kind, what, verdict = (ast.literal_eval(argument) for argument in mark.args)
                    body = "\n".join(ast.unparse(statement) for statement in function.body)
                    calls = CALLS[verdict]
                    assert kind in KINDS, f"{function.name}: {kind}"
                    assert not calls or any(call in body for call in calls), f"{function.name}: {verdict}"
                    yield kind, what, verdict, f"{path.relative_to(ROOT).as_posix()}::{function.name}"


def table():
    """Return the table: a row for each mark, in the order of kinds and verdicts."""
    order = [*CALLS]
    found = sorted(rows(), key=lambda row: (KINDS.index(row[0]), order.index(row[2]), row[1]))
    lines = ["| file | what it states | it is | test |", "|---|---|---|---|"]
    for kind, what, verdict, test in found:
        name = Path(test.partition("::")[0]).stem.removeprefix("test_")
        lines.append(f"| {kind} | {what} | {verdict} | `{name}` |")
    return "\n".join(lines)


def documented():
    """Return the document's text before the table, the table, and the text behind it."""
    text = DOCUMENT.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    found, after = rest.split(END)
    return before, found.strip(), after


def main():
    before, _, after = documented()
    DOCUMENT.write_text(f"{before}{BEGIN}\n{table()}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
