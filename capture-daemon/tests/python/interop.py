"""The other side of python_interop.rs: the public Python packages `mcap` and `mcap-ros2-support`.

    interop.py check                     exits 0 when the packages are there
    interop.py write FILE COMPRESSION    writes three frames
    interop.py read FILE                 prints what is in a file, one JSON line per message
"""

import json
import sys

from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer

HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

IMAGE = """std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data""" + HEADER

CAMERA_INFO = """std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi""" + HEADER + """================================================================================
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify
"""

WIDTH, HEIGHT = 20, 12


def write(path, compression):
    """Frame i has the counts 500 + 7·i + pixel index, and the stamp 1700000000.i·10⁸."""
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType[compression])
        image = writer.register_msgdef("sensor_msgs/msg/Image", IMAGE)
        info = writer.register_msgdef("sensor_msgs/msg/CameraInfo", CAMERA_INFO)
        for i in range(3):
            header = {"stamp": {"sec": 1_700_000_000, "nanosec": i * 100_000_000}, "frame_id": "camera"}
            log_time = 1_800_000_000_000_000_000 + i
            counts = [500 + 7 * i + pixel for pixel in range(WIDTH * HEIGHT)]
            data = b"".join(count.to_bytes(2, "little") for count in counts)
            # The image comes first, as it may.
            writer.write_message("/camera/depth/image_rect_raw", image, {
                "header": header, "height": HEIGHT, "width": WIDTH, "encoding": "16UC1",
                "is_bigendian": 0, "step": 2 * WIDTH, "data": data,
            }, log_time=log_time)
            writer.write_message("/camera/depth/camera_info", info, {
                "header": header, "height": HEIGHT, "width": WIDTH, "distortion_model": "plumb_bob",
                "d": [0.0] * 5, "k": [571.5, 0.0, 9.25, 0.0, 572.5, 5.75, 0.0, 0.0, 1.0],
                "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "p": [0.0] * 12,
                "binning_x": 0, "binning_y": 0,
                "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
            }, log_time=log_time)
        writer.finish()


def read(path):
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        chunks = reader.get_summary().chunk_indexes
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        print(json.dumps({
            "profile": reader.get_header().profile,
            "metadata": metadata,
            "longest_chunk_ns": max(chunk.message_end_time - chunk.message_start_time for chunk in chunks),
            "compressions": sorted({chunk.compression for chunk in chunks}),
        }))
    for decoded in read_ros2_messages(path):
        message = decoded.ros_msg
        line = {
            "topic": decoded.channel.topic,
            "schema": decoded.schema.name,
            "stamp_ns": message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec,
            "log_time_ns": decoded.log_time_ns,
            "size": [message.width, message.height],
        }
        if decoded.schema.name.endswith("Image"):
            line["encoding"] = message.encoding
            line["step"] = message.step
            line["data"] = bytes(message.data).hex()
        else:
            line["k"] = list(message.k)
            line["d"] = list(message.d)
        print(json.dumps(line))


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["check"]:
            pass
        case ["write", path, compression]:
            write(path, compression)
        case ["read", path]:
            read(path)
        case _:
            sys.exit(__doc__)
