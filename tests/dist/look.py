"""Holds what a package contains against what it is made of: look.py CRATES DIRECTORY PATH...

CRATES: what `cargo tree` prints of the program. DIRECTORY: the program and its list. PATH: what may stand in neither.
"""

import json
import re
import struct
import sys
import zlib
from pathlib import Path

crates, directory, *paths = sys.argv[1:]
wrong = []


def section(program, wanted):
    """The bytes of a section of an ELF file of 64 bits."""
    assert program[:5] == b"\x7fELF\x02", "no ELF file of 64 bits"
    order = "<" if program[5] == 1 else ">"
    at, = struct.unpack_from(order + "Q", program, 0x28)
    size, count, names = struct.unpack_from(order + "HHH", program, 0x3A)
    heads = [struct.unpack_from(order + "IIQQQQ", program, at + size * place) for place in range(count)]
    names_at = heads[names][4]
    for head in heads:
        begin = names_at + head[0]
        if program[begin : program.index(b"\0", begin)] == wanted:
            return program[head[4] : head[4] + head[5]]
    raise SystemExit(f"the program has no section {wanted.decode()}: it carries no list of its crates")


def compared(name, listed, known):
    missing, foreign = sorted(made_of - listed), sorted(listed - known)
    wrong.extend(f"{crate} {version} is not in {name}" for crate, version in missing)
    wrong.extend(f"{crate} {version} in {name} is not in Cargo.lock" for crate, version in foreign)


made_of = set(re.findall(r"^(\S+) v(\S+)", Path(crates).read_text(), re.M))
lock = set(re.findall(r'^name = "(.+)"\nversion = "(.+)"', Path("Cargo.lock").read_text(), re.M))
program = (Path(directory) / "isotherm").read_bytes()
text = (Path(directory) / "isotherm.cdx.json").read_text()

inside = json.loads(zlib.decompress(section(program, b".dep-v0")))["packages"]
linked = {(one["name"], one["version"]) for one in inside if one.get("kind", "runtime") == "runtime"}
compared("the list inside the program", {(one["name"], one["version"]) for one in inside}, lock)
# Both tools ask `cargo metadata`, which counts what only building and testing want of a crate, too: so they name a few that are
# not linked. None may be missing.
beyond = sorted(linked - made_of)
if len(beyond) > 0.05 * len(made_of):
    wrong.append(f"{len(beyond)} crates are not linked, and the program says they are: {beyond}")

document = json.loads(text)
whole = document["metadata"]["component"]
beside = [one for one in document["components"] + [whole] if one.get("scope") != "excluded"]
compared("isotherm.cdx.json", {(one["name"], one["version"]) for one in beside}, lock)
if (document["bomFormat"], document["specVersion"], whole["name"]) != ("CycloneDX", "1.5", "isotherm"):
    wrong.append(f"isotherm.cdx.json is something else: {whole['name']}, {document['specVersion']}")
for one in beside:
    if not one.get("licenses"):
        wrong.append(f"isotherm.cdx.json names no licence of {one['name']} {one['version']}")
    if not one["purl"].startswith(f"pkg:cargo/{one['name']}@{one['version']}"):
        wrong.append(f"isotherm.cdx.json calls {one['name']} {one['purl']}")

for path in paths:
    for name, content in [("the program", program), ("isotherm.cdx.json", text.encode())]:
        at = content.find(path.encode() + b"/")
        if at >= 0:
            wrong.append(f"a path of this computer stands in {name}: {content[at : at + 120]!r}")

print(*wrong, sep="\n", end="\n" if wrong else "")
if wrong:
    raise SystemExit(1)
print(f"{len(made_of)} crates: each inside the program (of {len(inside)}) and beside it (of {len(beside)}); "
      f"the program has {len(program) / 1e6:.1f} MB, and no path of {len(paths)}")
print("said to be linked and not:", ", ".join(f"{name} {version}" for name, version in beyond) or "none")
