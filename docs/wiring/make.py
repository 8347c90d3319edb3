"""Draws the wiring sheets, and the computed values of docs/wiring.md and docs/bring-up.md.

python docs/wiring/make.py            writes sheets and pages; needs docs/wiring/requirements.txt
python docs/wiring/make.py --check    fails when a bound of the design is broken, when pages or sheets are stale, or when
                                      the firmware disagrees; needs nothing but Python. Sheets are then compared by the
                                      hash of what they are drawn from, and as drawn where the drawing package is there.
"""

import argparse
import hashlib
import importlib
import re
import sys
from pathlib import Path

import arithmetic
import components
import firmware
import page

HERE = Path(__file__).resolve().parent
DOCS = HERE.parent
PAGES = ("wiring.md", "bring-up.md")
SHEETS = {
    "1-overview": "overview",
    "2-gap": "gap",
    "3-drive": "drive",
    "4-signals": "signals",
    "5-safety": "safety",
}


def digest(content):
    return hashlib.sha256(content).hexdigest()[:16]


def source(module, book):
    """Hash of all that a sheet is drawn from."""
    parts = [(HERE / name).read_bytes() for name in ("sheet.py", f"{module}.py", "pins.py", "requirements.txt")]
    parts.append(repr((components.PARTS, components.GIVEN, sorted(book.texts.items()))).encode())
    return digest(b"\0".join(parts))


def draw(stem, book):
    """The sheet, with the hashes of its source and of itself."""
    module = SHEETS[stem]
    made = source(module, book)
    text = importlib.import_module(module).sheet(book).svg(made)
    return text.replace(f"source {made}<", f"source {made}, drawing {digest(text.encode())}<", 1)


def installed():
    """Whether the drawing package is there in the version of requirements.txt."""
    try:
        import schemdraw
    except ImportError:
        return False
    return f"schemdraw=={schemdraw.__version__}" in (HERE / "requirements.txt").read_text()


def broken(book):
    """Bounds that do not hold."""
    for what, number, low, high, name in book.bounds:
        if (low is not None and number < low) or (high is not None and number > high):
            allowed = " and ".join(f"{w} {x:.4g}" for w, x in (("at least", low), ("at most", high)) if x is not None)
            yield f"{what}: {number:.4g} {name}, expected {allowed}"


def stale_pages(book):
    for name in PAGES:
        text = (DOCS / name).read_text()
        for match in page.MARKED.finditer(text):
            expected = page.text_of(match[1], book)
            if match[2] != expected:
                line = text.count("\n", 0, match.start()) + 1
                if match[1].startswith("table "):
                    pairs = zip(match[2].split("\n"), expected.split("\n"))
                    have, want = next(
                        ((a, b) for a, b in pairs if a != b), ("another number of rows", expected.strip())
                    )
                else:
                    have, want = match[2], expected
                yield f"docs/{name}:{line}, {match[1]}: {have}, expected {want}"
            if text[match.start() - 1] == "\n" and not match[1].startswith("table "):
                yield f"docs/{name}, {match[1]}: begins a line, which Markdown takes for HTML; expected within one"
        page.render(text, book)


def unmatched():
    """Parts of the table that no sheet shows, and parts on a sheet that the table does not have."""
    kinds = "BT|RV|RS|FB|KM|[RCDFKLQUY]"
    text = " ".join((HERE / f"{stem}.svg").read_text() for stem in SHEETS if (HERE / f"{stem}.svg").exists())
    shown = {f"{kind}{n}" for kind, n in re.findall(rf"\b({kinds})(\d+)", text)}
    for kind, low, high in re.findall(rf"\b({kinds})(\d{{3}})\.\.\1?(\d{{3}})", text):
        shown |= {f"{kind}{n}" for n in range(int(low), int(high) + 1)}
    for ref in sorted(components.PARTS.keys() - shown):
        yield f"{ref} {components.label(ref)}: in the component table, on no sheet"
    # U1 is the processor, U20 stands for U201 to U203.
    for ref in sorted(ref for ref in shown - components.PARTS.keys() if len(ref) > 3 and ref != "L6206"):
        yield f"{ref}: on a sheet, not in the component table"


def stale_sheets(book):
    drawn = installed()
    for stem, module in SHEETS.items():
        path = HERE / f"{stem}.svg"
        text = path.read_text() if path.exists() else ""
        have = re.search(r"<desc>source (\w+), drawing (\w+)</desc>", text)
        if have and digest(text.replace(f", drawing {have[2]}", "", 1).encode()) != have[2]:
            yield f"docs/wiring/{stem}.svg: changed by hand; run docs/wiring/make.py"
        elif not have or have[1] != source(module, book):
            yield f"docs/wiring/{stem}.svg: drawn from another source; run docs/wiring/make.py"
        elif drawn and draw(stem, book) != text:
            yield f"docs/wiring/{stem}.svg: is not what docs/wiring/{module}.py draws; run docs/wiring/make.py"


def check(book):
    count = 0
    for title, found in (
        ("bounds of the design", broken(book)),
        ("pages", stale_pages(book)),
        ("sheets", stale_sheets(book)),
        ("parts", unmatched()),
        ("firmware", firmware.compare(book)),
    ):
        for finding in found:
            print(f"{title}: {finding}", file=sys.stderr)
            count += 1
    compared = "as drawn" if installed() else "by their source"
    print(f"{len(book.texts)} values, {len(book.bounds)} bounds, {len(SHEETS)} sheets {compared}: {count} disagree")
    return 1 if count else 0


def write(book):
    for name in PAGES:
        path = DOCS / name
        path.write_text(page.render(path.read_text(), book))
    for stem in SHEETS:
        (HERE / f"{stem}.svg").write_text(draw(stem, book))
    return 1 if any(print(f"bounds of the design: {b}", file=sys.stderr) or True for b in broken(book)) else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    book = arithmetic.compute()
    return check(book) if parser.parse_args().check else write(book)


if __name__ == "__main__":
    sys.exit(main())
