"""A robot that speaks ROS 2's messages over zenoh, in a process of its own: `-m tests.loop.ros2_robot PORT RING`.

It writes and reads them by mcap-ros2-support, from their definitions, and moves as it is told. It takes commands in one
order of its joints and tells its states in another.
"""

import sys
import time

import numpy as np
import zenoh
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

from rehab_opt.loop.messages import JOINT_STATE
from rehab_opt.loop.shared_ring import SharedRing

FLOATS, LINE = "std_msgs/msg/Float64MultiArray", "\n" + "=" * 80 + "\n"
DEFINITION = LINE.join((
    "std_msgs/MultiArrayLayout layout\nfloat64[] data",
    "MSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "MSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n",
))  # fmt: skip
NAMES = ("wrist", "elbow", "shoulder")
START = (0.3, -0.2, 0.1)
TRUTH = np.dtype([("position", "<f8", (3,)), ("velocity", "<f8", (3,)), ("came", "<u8")])
DT = 0.005


def main() -> None:
    truth = SharedRing.attach(sys.argv[2])
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{sys.argv[1]}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    state_bytes = serialize_dynamic(JOINT_STATE.name, JOINT_STATE.definition)[JOINT_STATE.name]
    command_of = generate_dynamic(FLOATS, DEFINITION)[FLOATS]
    told = [np.zeros(3), 0]

    def came(sample: zenoh.Sample) -> None:
        told[0], told[1] = np.array(command_of(sample.payload.to_bytes()).data), told[1] + 1

    position, tick, begin = np.array(START), 0, time.monotonic()
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber("forward_velocity_controller/commands", came)
        publisher = session.declare_publisher("joint_states")
        while True:
            velocity = told[0]
            position = position + DT * velocity
            message = {
                "header": {"stamp": {"sec": tick, "nanosec": 5}, "frame_id": "base"}, "name": list(NAMES[::-1]),
                "position": position[::-1].tolist(), "velocity": velocity[::-1].tolist(), "effort": [],
            }  # fmt: skip
            publisher.put(state_bytes(message))
            truth.write(position=position, velocity=velocity, came=told[1])
            tick += 1
            time.sleep(max(0.0, begin + tick * DT - time.monotonic()))
        subscriber.undeclare()


if __name__ == "__main__":
    main()
