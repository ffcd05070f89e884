"""A Sparkplug host by pysparkplug's decoder, over a connection of paho's: it holds every message against the rules of hosts.

    sparkplug_host.py PORT GROUP NODE

Each message becomes a line of JSON; what breaks a rule is a line that begins with "WRONG". A line `rebirth` on stdin asks for a birth,
`measured AXIS ERROR` tells an axis's measured error, `write NAME VALUE` wants a metric changed. `state online` and `state offline` publish the
state of the host, as a primary host does.
"""

import json
import sys
import time

import paho.mqtt.client as mqtt
from pysparkplug import DataType, MessageType, Metric, NCmd, Topic

port, group, node = int(sys.argv[1]), sys.argv[2], sys.argv[3]
HOST = "scada"
birth_time = int(time.time() * 1000)
born = None
last = None


def wrong(why):
    print("WRONG", why, flush=True)


def heard(client, userdata, message):
    global born, last
    topic = Topic.from_str(message.topic)
    if topic.message_type == MessageType.NCMD:
        return
    if message.retain:
        wrong(f"{message.topic} is retained")
    payload = topic.message_type.payload.decode(message.payload, birth=born)
    said = {"kind": topic.message_type.value}
    if topic.message_type == MessageType.NDEATH:
        said["bd_seq"] = payload.bd_seq_metric.value
        if born is not None:
            number = next(metric.value for metric in born.metrics if metric.name == "bdSeq")
            said["of_birth"] = number == said["bd_seq"]
        born = None
    else:
        if topic.message_type == MessageType.NBIRTH:
            born, expected = payload, 0
            said["bd_seq"] = next(metric.value for metric in payload.metrics if metric.name == "bdSeq")
        else:
            expected = None if last is None else (last + 1) % 256
            if born is None:
                wrong("data before a birth")
        if expected is not None and payload.seq != expected:
            wrong(f"seq {payload.seq} instead of {expected}")
        last = payload.seq
        said["seq"] = payload.seq
        metrics = [metric for metric in payload.metrics if metric.name != "bdSeq"]
        said["historical"] = sum(1 for metric in metrics if metric.is_historical)
        said["metrics"] = {}
        for metric in metrics:
            said["metrics"].setdefault(metric.name, []).append(metric.timestamp)
    print(json.dumps(said), flush=True)


def state(word):
    global birth_time
    if word == "online":
        birth_time = int(time.time() * 1000)
    # The will of a host is made at its birth, and has the time of it.
    payload = json.dumps({"online": word == "online", "timestamp": birth_time})
    client.publish(f"spBv1.0/STATE/{HOST}", payload, qos=1, retain=True)


def commands(name, value, kind):
    now = int(time.time() * 1000)
    metric = Metric(timestamp=now, name=name, datatype=kind, value=value)
    topic = Topic(message_type=MessageType.NCMD, group_id=group, edge_node_id=node)
    payload = NCmd(timestamp=now, metrics=(metric,)).encode(include_dtypes=True)
    client.publish(str(topic), payload, qos=0)


client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id="host") if hasattr(mqtt, "CallbackAPIVersion") else mqtt.Client("host")
client.on_message = heard
client.on_connect = lambda client, *_: client.subscribe(f"spBv1.0/{group}/+/{node}", qos=1)
client.on_subscribe = lambda *_: print("listens", flush=True)
client.reconnect_delay_set(0.1, 0.5)
client.connect("127.0.0.1", port, keepalive=5)
client.loop_start()
for line in sys.stdin:
    words = line.split()
    if words[0] == "rebirth":
        commands("Node Control/Rebirth", True, DataType.BOOLEAN)
    elif words[0] == "measured":
        commands(f"axis/{words[1]}/measured_error_um", float(words[2]), DataType.DOUBLE)
    elif words[0] == "state":
        state(words[1])
    else:
        commands(words[1], words[2] == "true", DataType.BOOLEAN)
