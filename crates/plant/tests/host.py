"""pysparkplug's decoder and encoder, for tests of the edge node.

Line by line from stdin, JSON each; each is answered with a line of JSON.
  {"topic": TOPIC, "payload": HEX}                              what the message says; names come from the last birth
  {"command": NAME, "value": VALUE, "type": TYPE, "sent": MS}   the topic and the bytes of a command to shop/grinder-3
  {"command": NAME, "alias": NUMBER, …}                         the same by the alias
"""

import datetime
import json
import sys

from pysparkplug import DataType, MessageType, Metric, NCmd, Topic
from pysparkplug._protobuf import Payload

birth = None


def plain(metric):
    value = metric.value
    if isinstance(value, datetime.datetime):
        value = value.timestamp()
    return {
        "name": metric.name,
        "alias": metric.alias,
        "type": metric.datatype.name,
        "value": value,
        "timestamp": metric.timestamp,
        "historical": metric.is_historical,
        "null": metric.is_null,
    }


def properties(raw):
    """pysparkplug leaves properties out: what its messages say of them, by the reference's descriptors."""
    told = []
    for metric in Payload.FromString(raw).metrics:
        pairs = zip(metric.properties.keys, metric.properties.values, strict=True)
        told.append({key: [value.type, getattr(value, value.WhichOneof("value"))] for key, value in pairs})
    return told


def decoded(topic, raw):
    global birth
    topic = Topic.from_str(topic)
    assert str(topic.group_id) == "shop" and topic.edge_node_id == "grinder-3" and topic.device_id is None
    payload = topic.message_type.payload.decode(raw, birth=birth)
    if topic.message_type == MessageType.NBIRTH:
        birth = payload
    if topic.message_type == MessageType.NDEATH:
        return {"kind": "NDEATH", "metrics": [plain(payload.bd_seq_metric)]}
    metrics = [plain(metric) for metric in payload.metrics]
    for metric, found in zip(metrics, properties(raw), strict=True):
        metric["properties"] = found
    kind = topic.message_type.value
    return {"kind": kind, "seq": payload.seq, "timestamp": payload.timestamp, "metrics": metrics}


def command(asked):
    metric = Metric(
        timestamp=asked["sent"],
        name=None if "alias" in asked else asked["command"],
        alias=asked.get("alias"),
        datatype=DataType[asked["type"]],
        value=asked["value"],
    )
    topic = Topic(message_type=MessageType.NCMD, group_id="shop", edge_node_id="grinder-3")
    payload = NCmd(timestamp=asked["sent"], metrics=(metric,))
    return {"topic": str(topic), "payload": payload.encode(include_dtypes=asked.get("typed", False)).hex()}


for line in sys.stdin:
    asked = json.loads(line)
    answer = command(asked) if "command" in asked else decoded(asked["topic"], bytes.fromhex(asked["payload"]))
    print(json.dumps(answer), flush=True)
