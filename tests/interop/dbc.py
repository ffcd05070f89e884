"""Frames decoded by cantools. stdin is a JSON list of message names with data in hexadecimal.

The answer is a list of objects, each with the values of the signals that the frame contains.
"""

import json
import math
import sys

import cantools

database = cantools.database.load_file(sys.argv[1], encoding="utf-8")


def decoded(name, data):
    try:
        values = database.get_message_by_name(name).decode(bytes.fromhex(data), decode_choices=False)
    except cantools.database.errors.DecodeError:
        # No signal belongs to this value of the multiplexer.
        return None
    return {signal: value if math.isfinite(value) else None for signal, value in values.items()}


json.dump([decoded(name, data) for name, data in json.load(sys.stdin)], sys.stdout)
