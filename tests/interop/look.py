"""Opens a page in a real browser and prints the text that a person sees there.

Takes URL and the words to wait for. Prints the text once all of them are there; after a minute it prints what is there
and exits with 1. Some of the words are things to do, once all words before them are there:

  click:Cancel     presses the button with that text
  drag:SELECTOR    draws with the mouse over a tenth of what that selects
  eval:EXPRESSION  waits until that is true in the page
  size:390x844     looks at the page in a window of that size from then on
  dark             the same in dark colours
  shot:FILE        keeps a picture of the whole page
  print:EXPRESSION prints the value of that, as soon as it has one
  axe:FILE         checks the page with axe-core, whose script FILE is; a serious finding is printed, and the exit code is 1
  language:de      the browser of somebody who wants that language (wherever it stands)
  any-certificate  a browser that accepts every certificate (wherever it stands)

Speaks the browser's own debugging protocol; needs nothing but Python and chromium.
"""

import base64
import json
import os
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request

PATIENCE = 60
# The serious findings of axe-core, one on each line.
AXE = """axe.run(document, { resultTypes: ["violations"] }).then(({ violations }) => violations
  .filter(({ impact }) => impact === "serious" || impact === "critical")
  .flatMap(({ id, help, nodes }) => nodes.map(({ html, failureSummary }) => `${id}: ${help}: ${html}: ${failureSummary}`))
  .join("\\n"))"""


class Tab:
    """One open page, asked over its web socket."""

    def __init__(self, address):
        host, _, path = address.removeprefix("ws://").partition("/")
        name, port = host.split(":")
        self.socket = socket.create_connection((name, int(port)), timeout=PATIENCE)
        key = base64.b64encode(os.urandom(16)).decode()
        request = f"GET /{path} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        request += f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n"
        self.socket.sendall(request.encode())
        self.file = self.socket.makefile("rb")
        while self.file.readline().strip():
            pass
        self.asked = 0

    def ask(self, method, **parameters):
        self.asked += 1
        self.send(json.dumps({"id": self.asked, "method": method, "params": parameters}).encode())
        while True:
            answer = json.loads(self.receive())
            if answer.get("id") == self.asked:
                # A page that loads itself again has no answer in this moment.
                return answer.get("result", {})

    def evaluate(self, expression, waits=False):
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=waits)
        if waits and "exceptionDetails" in answer:
            sys.exit(f"the page fails: {answer['exceptionDetails']}")
        return answer.get("result", {}).get("value")

    def print_value(self, expression):
        print(wait_for(f"a value of {expression}", lambda: self.evaluate(expression)))

    def check_access(self, file):
        with open(file) as script:
            self.evaluate(script.read())
        found = self.evaluate(AXE, waits=True)
        if found:
            sys.exit(f"axe-core finds:\n{found}")

    def resize(self, size):
        width, height = map(int, size.split("x"))
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600)

    def darken(self):
        self.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])

    def keep_picture(self, path):
        picture = self.ask("Page.captureScreenshot", captureBeyondViewport=True)["data"]
        with open(path, "wb") as file:
            file.write(base64.b64decode(picture))

    def drag(self, selector):
        place = f"document.querySelector({json.dumps(selector)})"
        self.evaluate(f"{place}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
        box = self.evaluate(f"JSON.stringify({place}.getBoundingClientRect())")
        box = json.loads(box)
        y = box["y"] + box["height"] / 2
        for kind, share in [("mouseMoved", 0.3), ("mousePressed", 0.3), ("mouseMoved", 0.35), ("mouseMoved", 0.4), ("mouseReleased", 0.4)]:
            x = box["x"] + box["width"] * share
            buttons = 0 if (kind, share) == ("mouseMoved", 0.3) else 1
            self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)

    def click(self, name):
        named = f"[...document.querySelectorAll('button')].find((button) => button.textContent === {json.dumps(name)})"
        self.evaluate(f"{named}.click()")

    def send(self, payload):
        # A mask of zeros leaves the payload as it is.
        mask = bytes(4)
        if len(payload) < 1 << 16:
            length = struct.pack(">BH", 0x80 | 126, len(payload))
        else:
            length = struct.pack(">BQ", 0x80 | 127, len(payload))
        self.socket.sendall(b"\x81" + length + mask + payload)

    def receive(self):
        length = self.file.read(2)[1] & 0x7F
        if length == 126:
            (length,) = struct.unpack(">H", self.file.read(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", self.file.read(8))
        return self.file.read(length)


def wait_for(what, look):
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        found = look()
        if found:
            return found
        time.sleep(0.2)
    sys.exit(f"the browser never had {what}")


def main(url, words):
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
        command = ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        languages = [word.removeprefix("language:") for word in words if word.startswith("language:")]
        words = [word for word in words if not word.startswith("language:")]
        if "any-certificate" in words:
            command.append("--ignore-certificate-errors")
            words.remove("any-certificate")
        command += [f"--accept-lang={language}" for language in languages]
        command += ["--remote-debugging-port=0", f"--user-data-dir={home}", url]
        log = open(os.path.join(home, "log"), "w")
        browser = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            return look(home, url, words)
        finally:
            browser.terminate()
            browser.wait()


def look(home, url, words):
    note = os.path.join(home, "DevToolsActivePort")
    port = wait_for("a port", lambda: os.path.exists(note) and open(note).read().split("\n")[0])

    def page():
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            pages = [tab for tab in json.load(answer) if tab["url"].startswith(url)]
        return pages and pages[0]["webSocketDebuggerUrl"]

    tab = Tab(wait_for("the page", page))
    does = {"click": tab.click, "drag": tab.drag, "size": tab.resize, "shot": tab.keep_picture, "dark": lambda _: tab.darken(), "print": tab.print_value, "axe": tab.check_access}
    waiting = []
    for word in words:
        kind, _, what = word.partition(":")
        if kind not in does:
            waiting.append(word)
            continue
        if not shows(tab, waiting):
            return 1
        does[kind](what)
        waiting = []
    is_there = shows(tab, waiting)
    print(tab.evaluate("document.body.innerText"))
    return 0 if is_there else 1


def shows(tab, words):
    deadline = time.monotonic() + PATIENCE
    while True:
        text = tab.evaluate("document.body.innerText") or ""
        missing = [word for word in words if not is_true(tab, word, text)]
        if not missing:
            return True
        if time.monotonic() > deadline:
            print(text)
            print("missing:", missing, file=sys.stderr)
            return False
        time.sleep(0.2)


def is_true(tab, word, text):
    if word.startswith("eval:"):
        return tab.evaluate(word.removeprefix("eval:")) is True
    return word in text


sys.exit(main(sys.argv[1], sys.argv[2:]))
