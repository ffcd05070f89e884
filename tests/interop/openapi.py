"""Checks the description of the API (/openapi.json) against a running gateway: the document itself with openapi-spec-validator, and each
answer with jsonschema. A field that the document does not name is wrong too.

    openapi.py http://127.0.0.1:8080 [OPERATOR_TOKEN]

Without a token, commands are not tried. Prints one line for each answer: method, path, status code. A line that begins with "WRONG" is a
mismatch; the exit code is then 1.
"""

import copy
import json
import sys
import urllib.error
import urllib.request

from jsonschema import Draft202012Validator
from openapi_spec_validator import validate

base = sys.argv[1].rstrip("/")
token = sys.argv[2] if len(sys.argv) > 2 else None
failed = False


def wrong(what):
    global failed
    failed = True
    print("WRONG", what, flush=True)


def ask(method, path, body=None, given=token):
    request = urllib.request.Request(base + path, method=method, data=body)
    if given is not None:
        request.add_header("Authorization", f"Bearer {given}")
    try:
        return urllib.request.urlopen(request, timeout=60)
    except urllib.error.HTTPError as error:
        return error


document = json.load(ask("GET", "/openapi.json"))
validate(document)


def strict(schema):
    """The same schema, in which an object has no other fields than those that are named."""
    if isinstance(schema, list):
        return [strict(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    schema = {key: strict(value) for key, value in schema.items()}
    if isinstance(schema.get("properties"), dict) and "type" in schema:
        schema.setdefault("additionalProperties", False)
    return schema


components = {"schemas": strict(copy.deepcopy(document["components"]["schemas"]))}


def matches(schema, value, where):
    validator = Draft202012Validator({**strict(copy.deepcopy(schema)), "components": components})
    for error in validator.iter_errors(value):
        wrong(f"{where}: {'/'.join(map(str, error.absolute_path))}: {error.message[:300]}")


def checked(method, pattern, query="", body=None, given=token):
    """Sends a request, and compares its answer with the document. Returns the status code."""
    operation = document["paths"][pattern][method.lower()]
    path = pattern.replace("{axis}", axis) + query
    where = f"{method} {path}"
    with ask(method, path, body, given) as answer:
        code, kind = str(answer.status), answer.headers.get_content_type()
        print(where, code, flush=True)
        described = operation["responses"].get(code)
        if described is None:
            wrong(f"{where}: the document has no {code}")
            return code
        if kind not in described["content"]:
            wrong(f"{where}: {kind} is not among {list(described['content'])}")
            return code
        schema = described["content"][kind]["schema"]
        if kind == "text/event-stream":
            line = next(line for line in answer if line.startswith(b"data: "))
            matches({"$ref": "#/components/schemas/Status"}, json.loads(line[6:]), where)
        elif kind == "application/json":
            matches(schema, json.load(answer), where)
        elif not answer.read():
            wrong(f"{where}: the answer is empty")
        return code


with ask("GET", "/api/status") as answer:
    axis = json.load(answer)["axes"][0]["name"]

for pattern, operations in document["paths"].items():
    if "get" in operations:
        checked("GET", pattern)
    # Which methods an address accepts needs no token.
    with ask("PATCH", pattern.replace("{axis}", axis), given=None) as answer:
        allowed = set(answer.headers.get("Allow", "").split(",")) - {"HEAD"}
        if answer.status != 405 or allowed != {method.upper() for method in operations}:
            wrong(f"PATCH {pattern}: {answer.status}, {allowed}")

for pattern, query in [
    ("/api/events", "?since=yesterday"),
    ("/api/history", "?points=1"),
    ("/api/history", "?columns=nothing"),
    ("/api/history.csv", "?from=1h&to=2h"),
]:
    if checked("GET", pattern, query) not in ["400", "404"]:
        wrong(f"{pattern}{query} is accepted")

if token is not None:
    measured = "/api/axes/{axis}/measured"
    for pattern, operations in document["paths"].items():
        for method in operations:
            if method != "get" and checked(method.upper(), pattern, given=None) != "401":
                wrong(f"{method} {pattern} requires no token")
            if method == "post" and pattern not in [measured, "/api/logout"]:
                checked("POST", pattern)
                checked("POST", pattern, "?axis=nothing")
    for body in [b'{"error_um": 1.5}', b'{"error_um": 1e6}', b"3.2"]:
        checked("POST", measured, body=body)
    checked("DELETE", measured)
    checked("POST", "/api/logout")
    axis = "nothing"
    if checked("DELETE", measured) != "404":
        wrong("there is an axis with the name nothing")

print("read", len(document["paths"]), "paths", flush=True)
sys.exit(failed)
