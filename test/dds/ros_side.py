"""A ROS 2 process as far as DDS goes, for tests: nothing of the package under test is in it.

The types are written by hand as rosidl's generator for DDS names them; the configuration is what rmw_cyclonedds makes
of ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST. Takes a JSON object a line, and answers each with one.
With an argument it does so in one domain after another, since the imports take half a second.
"""

import json
import os
import sys
import time
import uuid
from dataclasses import dataclass

from cyclonedds import _clayer
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant, BuiltinTopicDcpsPublication
from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import array, bounded_str, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

CONFIG = (
    '<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General><Discovery>'
    '<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>'
    '<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>'
)
WAIT_S = 15.0


@dataclass
@final
class Time(IdlStruct, typename='builtin_interfaces.msg.dds_.Time_'):
    sec: int32
    nanosec: uint32


@dataclass
@final
class Header(IdlStruct, typename='std_msgs.msg.dds_.Header_'):
    stamp: Time
    frame_id: str


@dataclass
@final
class Vector3(IdlStruct, typename='geometry_msgs.msg.dds_.Vector3_'):
    x: float64
    y: float64
    z: float64


@dataclass
@final
class Wrench(IdlStruct, typename='geometry_msgs.msg.dds_.Wrench_'):
    force: Vector3
    torque: Vector3


@dataclass
@final
class WrenchStamped(IdlStruct, typename='geometry_msgs.msg.dds_.WrenchStamped_'):
    header: Header
    wrench: Wrench


@dataclass
@final
class Image(IdlStruct, typename='sensor_msgs.msg.dds_.Image_'):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
@final
class Log(IdlStruct, typename='rcl_interfaces.msg.dds_.Log_'):
    stamp: Time
    level: uint8
    name: str
    msg: str
    file: str
    function: str
    line: uint32


@dataclass
@final
class Gid(IdlStruct, typename='rmw_dds_common.msg.dds_.Gid_'):
    data: array[uint8, 16]


@dataclass
@final
class NodeEntitiesInfo(IdlStruct, typename='rmw_dds_common.msg.dds_.NodeEntitiesInfo_'):
    node_namespace: bounded_str[256]
    node_name: bounded_str[256]
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
@final
class ParticipantEntitiesInfo(IdlStruct, typename='rmw_dds_common.msg.dds_.ParticipantEntitiesInfo_'):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


TYPES = {kind.__name__: kind for kind in (WrenchStamped, Image, Log, ParticipantEntitiesInfo)}
ANY = SampleState.Any | ViewState.Any | InstanceState.Any


class RosSide:
    def __init__(self, domain_id: int) -> None:
        self.domain = Domain(domain_id, CONFIG)
        self.participant = DomainParticipant(domain_id)
        self.readers: dict = {}
        self.writer = None
        self.ends: dict = {}
        self.announced: dict = {}
        self.came = BuiltinDataReader(self.participant, BuiltinTopicDcpsPublication)
        self.others = BuiltinDataReader(self.participant, BuiltinTopicDcpsParticipant)

    def listen(self, topic: str, kind: str, latched: bool = False, reliable: bool = True) -> dict:
        about = Topic(self.participant, topic, TYPES[kind])
        qos = Qos(
            Policy.Reliability.Reliable(0) if reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(100),
        )
        self.readers[topic] = DataReader(self.participant, about, qos)
        return {}

    def take(self, topic: str, wait_s: float = WAIT_S) -> dict:
        """The next sample, as it came and as these types read it."""
        reader = self.readers[topic]
        fresh = ReadCondition(reader, ANY)
        waiting = WaitSet(self.participant)
        waiting.attach(fresh)
        waiting.wait(round(wait_s * 1e9))
        found = _clayer.ddspy_take(reader._ref, ANY, 1)
        if not found or not found[0][1].valid_data:
            return {'data': None}
        data = found[0][0]
        return {'data': data.hex(), 'text': repr(reader.topic.data_type.deserialize(data))}

    def nodes(self, wanted: list) -> dict:
        """The nodes that a participant announces, with the topics of their writers and readers' count."""
        until = time.monotonic() + WAIT_S
        self.readers.get('ros_discovery_info') or self.listen('ros_discovery_info', 'ParticipantEntitiesInfo', True)
        while time.monotonic() < until:
            self.ends |= {str(end.key): end for end in self.came.take(200) if end.sample_info.valid_data}
            for info in self.readers['ros_discovery_info'].take(50):
                self.announced = {
                    node.node_namespace.rstrip('/') + '/' + node.node_name: (
                        [str(_uuid(gid)) for gid in node.writer_gid_seq],
                        len(node.reader_gid_seq),
                    )
                    for node in info.node_entities_info_seq
                }
            known = all(gid in self.ends for gids, _ in self.announced.values() for gid in gids)
            if known and all(name in self.announced for name in wanted):
                break
            time.sleep(0.05)
        return {
            'nodes': {
                name: {
                    'topics': {
                        end.topic_name: [end.type_name, end.qos[Policy.Userdata].data.decode()]
                        for gid in gids
                        if (end := self.ends.get(gid))
                    },
                    'readers': readers,
                }
                for name, (gids, readers) in self.announced.items()
            }
        }

    def found(self, topic: str) -> dict:
        """Wait until the reader knows of a writer: before, what is not reliable gets lost."""
        until = time.monotonic() + WAIT_S
        while not self.readers[topic].get_matched_publications() and time.monotonic() < until:
            time.sleep(0.02)
        return {'writers': len(self.readers[topic].get_matched_publications())}

    def write(self, topic: str, x: float, z: float) -> dict:
        """Send a wrench, once somebody is there to read it."""
        if self.writer is None:
            self.writer = DataWriter(
                self.participant, Topic(self.participant, topic, WrenchStamped), Qos(Policy.Reliability.BestEffort)
            )
        until = time.monotonic() + WAIT_S
        while not self.writer.get_matched_subscriptions() and time.monotonic() < until:
            time.sleep(0.02)
        force = Wrench(Vector3(x, 0.0, z), Vector3(0.0, 0.0, 0.0))
        self.writer.write(WrenchStamped(Header(Time(12, 34), 'robot_wrist'), force))
        return {'readers': len(self.writer.get_matched_subscriptions())}

    def gone(self) -> dict:
        """Wait until everybody else has left; the seconds that took."""
        begun = time.monotonic()
        own = str(self.participant.guid)
        while time.monotonic() < begun + 5.0:  # whoever leaves without a word is taken to be there for 10 s
            alive = {str(one.key) for one in self.others.read(50) if one.sample_info.instance_state == 16}
            if not alive - {own}:
                return {'seconds': time.monotonic() - begun}
            time.sleep(0.02)
        return {'seconds': None}


def _uuid(gid: Gid):
    return uuid.UUID(bytes=bytes(gid.data))


def answer(domain_id: int) -> None:
    side = RosSide(domain_id)
    print(json.dumps({'pid': os.getpid()}), flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        print(json.dumps(getattr(side, order.pop('do'))(**order)), flush=True)


def answer_again_and_again() -> None:
    """Each line is a domain, in which a process of its own answers until it is killed."""
    for line in sys.stdin:
        child = os.fork()
        if not child:
            answer(int(line))
            os._exit(0)
        os.waitpid(child, 0)
        print(json.dumps({'ended': child}), flush=True)


if __name__ == '__main__':
    answer_again_and_again() if sys.argv[1:] else answer(int(os.environ['ROS_DOMAIN_ID']))
