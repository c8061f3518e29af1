"""A ROS 2 process as far as DDS goes, by the Cyclone DDS that ROS 2 Jazzy has: 0.10, as Debian packages its C library.

Nothing of the package under test is in it, nor of Cyclone's package for Python. Takes a JSON object a line, and answers
each with one.
"""

import ctypes
import json
import os
import sys
import time
from ctypes import POINTER, Structure, byref, c_bool, c_char_p, c_double, c_int32, c_int64, c_uint32, c_uint64, c_void_p

LIBRARY = 'libddsc.so.0debian'
# What rmw_cyclonedds makes of ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST.
CONFIG = (
    '<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General>'
    '<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>'
    '<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>'
)
WAIT_S = 60.0
PUBLICATIONS = 0x7FFF0000 + 3  # DDS_BUILTIN_TOPIC_DCPSPUBLICATION, dds.h
FOUR, EIGHT, TEXT = ((1 << 24) | (kind << 16) for kind in (3, 4, 5))  # DDS_OP_ADR | DDS_OP_TYPE_*, dds_opcodes.h
FLOATING, SIGNED = 1 << 1, 1 << 2  # DDS_OP_FLAG_FP, DDS_OP_FLAG_SGN


class SampleInfo(Structure):
    _fields_ = (
        ('states', c_uint32 * 3),
        ('valid_data', c_bool),
        ('source_timestamp', c_int64),
        ('instance_handle', c_uint64),
        ('publication_handle', c_uint64),
        ('counts', c_uint32 * 2),
        ('ranks', c_uint32 * 3),
    )


class Endpoint(Structure):
    """dds_builtintopic_endpoint_t"""

    _fields_ = (
        ('keys', c_uint64 * 4),
        ('participant', c_uint64),
        ('topic_name', c_char_p),
        ('type_name', c_char_p),
        ('qos', c_void_p),
    )


class Wrench(Structure):
    """geometry_msgs/WrenchStamped, as a C compiler lays it out."""

    _fields_ = (('sec', c_int32), ('nanosec', c_uint32), ('frame_id', c_char_p), ('values', c_double * 6))


class Descriptor(Structure):
    """dds_topic_descriptor_t"""

    _fields_ = (
        ('size', c_uint32),
        ('align', c_uint32),
        ('flags', c_uint32),
        ('key_count', c_uint32),
        ('type_name', c_char_p),
        ('keys', c_void_p),
        ('op_count', c_uint32),
        ('ops', POINTER(c_uint32)),
        ('meta', c_char_p),
        ('type_information', c_uint64 * 2),
        ('type_mapping', c_uint64 * 2),
        ('representation', c_uint32),
    )


def descriptor_of_wrench() -> Descriptor:
    numbers = [word for place in range(6) for word in (EIGHT | FLOATING, 16 + 8 * place)]
    words = [FOUR | SIGNED, 0, FOUR, 4, TEXT, 8, *numbers, 0]
    ops = (c_uint32 * len(words))(*words)
    name = b'geometry_msgs::msg::dds_::WrenchStamped_'
    return Descriptor(ctypes.sizeof(Wrench), 8, 0, 0, name, None, len(words), ops, b'')


class OlderSide:
    def __init__(self, domain_id: int) -> None:
        self.dds = ctypes.CDLL(LIBRARY)
        self.made('dds_create_domain', c_uint32(domain_id), CONFIG.encode())
        self.participant = self.made('dds_create_participant', c_uint32(domain_id), None, None)
        self.publications = self.made('dds_create_reader', self.participant, PUBLICATIONS, None, None)
        self.known: dict = {}
        self.descriptor = descriptor_of_wrench()
        self.readers: dict = {}

    def made(self, function: str, *arguments) -> int:
        entity = getattr(self.dds, function)(*arguments)
        if entity < 0:
            raise RuntimeError(f'{function}: {entity}')
        return entity

    def taken(self, reader: int, kind):
        """The next sample, or None where there is none now."""
        sample, info = (c_void_p * 1)(), SampleInfo()
        if self.made('dds_take', reader, sample, byref(info), 1, 1) == 0:
            return None
        found = ctypes.cast(sample[0], POINTER(kind)).contents
        answer = {name: getattr(found, name) for name, _ in kind._fields_} if info.valid_data else {}
        answer = {name: list(value) if hasattr(value, '__len__') else value for name, value in answer.items()}
        text = {name: bytes(value).decode() for name, value in answer.items() if name.endswith(('_name', '_id'))}
        self.dds.dds_return_loan(reader, sample, 1)
        return text | {name: answer[name] for name in ('sec', 'nanosec', 'values') if name in answer}

    def finds(self, topic: str, wait_s: float = WAIT_S) -> dict:
        """Wait until somebody offers a topic; its type, and the seconds that took."""
        begun = time.monotonic()
        while topic not in self.known and time.monotonic() < begun + wait_s:
            while (end := self.taken(self.publications, Endpoint)) is not None:
                if end:
                    self.known[end['topic_name']] = end['type_name']
            time.sleep(0.01)
        return {'type': self.known.get(topic), 'seconds': time.monotonic() - begun}

    def listen(self, topic: str) -> dict:
        about = self.made('dds_create_topic', self.participant, byref(self.descriptor), topic.encode(), None, None)
        self.readers[topic] = self.made('dds_create_reader', self.participant, about, None, None)
        return {}

    def take(self, topic: str, wait_s: float = WAIT_S) -> dict:
        """The next wrench."""
        until = time.monotonic() + wait_s
        while time.monotonic() < until:
            if found := self.taken(self.readers[topic], Wrench):
                return found
            time.sleep(0.01)
        return {}


def main() -> None:
    side = OlderSide(int(os.environ['ROS_DOMAIN_ID']))
    print(json.dumps({'ready': True}), flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        print(json.dumps(getattr(side, order.pop('do'))(**order)), flush=True)


if __name__ == '__main__':
    main()
