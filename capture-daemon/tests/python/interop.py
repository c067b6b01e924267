"""The other side of python_interop.rs: the public Python packages `mcap` and `mcap-ros2-support`.

    interop.py check                     exits 0 when the packages are there
    interop.py write FILE FORM           writes frames; FORM is JSON, see `write`
    interop.py pictures FOLDER           writes the same three frames as PNGs with a camera.toml
    interop.py whole FILE                prints, for each length that the file can be cut to, how many
                                         images are whole by then, as a JSON list
    interop.py read FILE                 prints what is in a file, one JSON line per message
"""

import io
import json
import pathlib
import struct
import sys
import zlib

import lz4.frame
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
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


def pixels(form, i):
    """Row by row, frame i has the counts 500 + 7·i + pixel index; in metres for 32FC1."""
    order = ">" if form.get("big_endian") else "<"
    rows = []
    for row in range(HEIGHT):
        counts = [500 + 7 * i + row * WIDTH + column for column in range(WIDTH)]
        if form.get("encoding") == "32FC1":
            metres = [count * 1e-3 for count in counts]
            if row == 0:
                metres[:3] = [float("nan"), float("inf"), -1.0]
            data = struct.pack(f"{order}{WIDTH}f", *metres)
        else:
            data = struct.pack(f"{order}{WIDTH}H", *counts)
        rows.append(data + b"\xee" * form.get("padding", 0))
    return b"".join(rows), len(rows[0])


def write(path, form):
    """Three frames, by `form`: `compression`, `chunked`, `summary`, `chunk_size` for the file;
    `topics` for the images; `encoding`, `padding`, `big_endian`, `stamp` for each image; `model` and
    `d` for the intrinsics, and `info`: "before" or "after" the first image, or "never"; `order`: of
    the frames. Frame i has the stamp 1700000000 s + i·0.1 s and is logged a hundred million seconds later."""
    summary = form.get("summary", True)
    with open(path, "wb") as file:
        writer = Writer(io.BytesIO())
        writer._writer = McapWriter(
            file, chunk_size=form.get("chunk_size", 1 << 20),
            compression=CompressionType[form.get("compression", "ZSTD")],
            use_chunking=form.get("chunked", True), use_statistics=summary, use_summary_offsets=summary,
            repeat_channels=summary, repeat_schemas=summary,
            index_types=IndexType.ALL if summary else IndexType.NONE)
        writer._writer.start(profile="ros2", library="the tests")
        image = writer.register_msgdef("sensor_msgs/msg/Image", IMAGE)
        info = writer.register_msgdef("sensor_msgs/msg/CameraInfo", CAMERA_INFO)

        def write_info(header, log_time):
            writer.write_message("/camera/depth/camera_info", info, {
                "header": header, "height": HEIGHT, "width": WIDTH,
                "distortion_model": form.get("model", "plumb_bob"), "d": form.get("d", [0.0] * 5),
                "k": [571.5, 0.0, 9.25, 0.0, 572.5, 5.75, 0.0, 0.0, 1.0],
                "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "p": [0.0] * 12,
                "binning_x": 0, "binning_y": 0,
                "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
            }, log_time=log_time)

        for i in form.get("order", range(3)):
            stamp = {"sec": 1_700_000_000 + i // 10, "nanosec": i % 10 * 100_000_000}
            if not form.get("stamp", True):
                stamp = {"sec": 0, "nanosec": 0}
            header = {"stamp": stamp, "frame_id": "camera"}
            log_time = 1_800_000_000_000_000_000 + i * 100_000_000
            if form.get("info", "after") == "before":
                write_info(header, log_time)
            data, step = pixels(form, i)
            for topic in form.get("topics", ["/camera/depth/image_rect_raw"]):
                writer.write_message(topic, image, {
                    "header": header, "height": HEIGHT, "width": WIDTH,
                    "encoding": form.get("encoding", "16UC1"),
                    "is_bigendian": int(form.get("big_endian", False)), "step": step, "data": data,
                }, log_time=log_time)
            if form.get("info", "after") == "after":
                write_info(header, log_time)
        writer.add_metadata("session", {"visitor": "a child"})
        writer.finish()


def pictures(folder):
    """PNG as its specification has it: big-endian, each row behind the number of its filter, here 0."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    for i in range(3):
        data, step = pixels({"big_endian": True}, i)
        rows = b"".join(b"\0" + data[row * step:(row + 1) * step] for row in range(HEIGHT))
        png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", WIDTH, HEIGHT, 16, 0, 0, 0, 0))
        png += chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
        pathlib.Path(folder, f"depth_{i}.png").write_bytes(png)
    camera = "fx = 571.5\nfy = 572.5\ncx = 9.25\ncy = 5.75\ndepth_unit_m = 0.001\nfps = 10\n"
    pathlib.Path(folder, "camera.toml").write_text(camera)


def records(data):
    """The whole records at the start of some bytes: kind, content; then how far they reach."""
    found, at = [], 0
    while at + 9 <= len(data):
        kind, length = data[at], int.from_bytes(data[at + 1:at + 9], "little")
        if at + 9 + length > len(data):
            break
        found.append((kind, data[at + 9:at + 9 + length]))
        at += 9 + length
    return found, at


def decompressed(compression, data):
    """What can be had of a compressed chunk of which this is the start."""
    match compression:
        case b"":
            return data
        case b"zstd":
            return zstandard.ZstdDecompressor().decompressobj().decompress(data)
        case b"lz4":
            # Room for all of it: else what a whole block holds comes in pieces.
            context = lz4.frame.create_decompression_context()
            return lz4.frame.decompress_chunk(context, data, max_length=1 << 20)[0] if data else b""


def whole(path):
    with open(path, "rb") as file:
        data = file.read()

    def of_chunk(content):
        """The records of a chunk, of which the end may be missing."""
        if len(content) < 32:
            return []
        name_length = int.from_bytes(content[28:32], "little")
        start = 32 + name_length + 8
        return records(decompressed(content[32:32 + name_length], content[start:]))[0] if len(content) >= start else []

    def images(found, schemas, channels):
        count = 0
        for kind, content in found:
            if kind == 3:
                (length,) = struct.unpack_from("<I", content, 2)
                schemas[content[:2]] = content[6:6 + length]
            elif kind == 4:
                channels[content[:2]] = schemas.get(content[2:4])
            elif kind == 5:
                count += channels.get(content[:2]) == b"sensor_msgs/msg/Image"
        return count

    counts = []
    for length in range(len(data) + 1):
        count, schemas, channels = 0, {}, {}
        found, at = records(data[8:length])
        for kind, content in found:
            if kind == 0x0f:
                break
            count += images(of_chunk(content) if kind == 6 else [(kind, content)], schemas, channels)
        else:
            rest = data[8 + at:length]
            if len(rest) > 9 and rest[0] == 6:
                count += images(of_chunk(rest[9:]), schemas, channels)
        counts.append(count)
    print(json.dumps(counts))


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
        if decoded.schema.name == "std_msgs/msg/String":
            print(json.dumps({"topic": decoded.channel.topic, "text": message.data}))
            continue
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
        case ["write", path, form]:
            write(path, json.loads(form))
        case ["pictures", folder]:
            pictures(folder)
        case ["whole", path]:
            whole(path)
        case ["read", path]:
            read(path)
        case _:
            sys.exit(__doc__)
