"""Calls every method of io.sward.Station with the public varlink package. Arguments: the socket, and
what to do: `check` says whether the package is there, `call` calls."""

import mmap
import os
import socket
import struct
import sys


class WithDescriptors:
    """A socket that keeps the descriptors that come with the bytes, which the package does not look for."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(path)
        self.descriptors = []

    def sendall(self, data):
        self.socket.sendall(data)

    def recv(self, size):
        data, descriptors, _, _ = socket.recv_fds(self.socket, size, 8)
        self.descriptors += descriptors
        return data

    def close(self):
        self.socket.close()


def read_preview(client):
    """Reads the bytes of previews as the interface describes them."""
    import varlink

    connection = WithDescriptors(sys.argv[2])
    station = varlink.SimpleClientInterfaceHandler(client.get_interface("io.sward.Station"), connection)
    after = 0
    for _ in range(3):
        reply = station.GetPreview(after=after)
        descriptor = connection.descriptors.pop(reply["fd"])
        assert connection.descriptors == []
        with mmap.mmap(descriptor, 0, prot=mmap.PROT_READ) as shared:
            data = bytes(shared)
        os.close(descriptor)
        (
            magic, version, header_size, total, sequence, frame, time_ns, width, height, fx, fy, cx, cy, near, far,
            state, hold, has_capture, _, _, blades, polylines, points, words, code, reserved,
        ) = struct.unpack_from("<8sIIQQQQII4f2HIfIQQIIII24s16s", data)  # fmt: skip
        assert (magic, version, header_size, total) == (b"SWARDPRV", 1, 160, reply["size"]), data[:160]
        assert len(data) == total and sequence == reply["sequence"] and reserved == bytes(16)
        assert sequence > after and time_ns > 10**18 and 0 <= frame < 1000
        assert (width, height, near, far) == (640, 480, 300, 900)
        assert min(fx, fy, cx, cy) > 100 and 0 <= hold <= 1
        assert ("no_source", "waiting", "settling", "captured")[state] == reply["state"]
        assert (has_capture, blades) == (0, 0), "it is captured by hand alone"
        assert code.rstrip(b"\0").decode() == reply["code"] in ("waiting", "hold_still")
        depth = struct.unpack_from(f"<{width * height}H", data, 160)
        mask_at = 160 + 2 * width * height
        for mm, bits in zip(depth, data[mask_at : mask_at + width * height]):
            assert (bits & 1) == (near <= mm <= far), (mm, bits)
        labels = data[mask_at + width * height : mask_at + 2 * width * height]
        assert not any(labels)
        lines_at = (160 + 4 * width * height + 15) // 16 * 16
        points_at = lines_at + 16 * polylines
        words_at = points_at + 16 * points
        assert data[words_at:].decode() == reply["words"] and words_at + words == total
        next_point = 0
        for line in range(polylines):
            kind, _, first, count = struct.unpack_from("<4I", data, lines_at + 16 * line)
            assert kind == 0 and first == next_point and count >= 2
            next_point += count
            for point in range(first, first + count):
                x, y, left, right = struct.unpack_from("<4f", data, points_at + 16 * point)
                assert -1 <= x <= width and -1 <= y <= height and left == right == 0
        assert next_point == points
        after = sequence
    connection.close()


def main():
    import varlink

    if sys.argv[1] == "check":
        return
    client = varlink.Client.new_with_address("unix:" + sys.argv[2])
    assert "io.sward.Station" in client.get_interfaces(), client.get_interfaces()

    def refused(expected, call, **parameters):
        try:
            call(**parameters)
        except varlink.VarlinkError as error:
            assert error.error() == expected, error
        else:
            raise AssertionError(expected + " is not said")

    with client.open("io.sward.Station") as station:
        members = client.get_interface("io.sward.Station").members
        methods = {name for name in members if hasattr(station, name)}
        called = set()

        def call(method, **parameters):
            called.add(method)
            return getattr(station, method)(**parameters)

        status = call("GetStatus")["status"]
        assert status["store"] == "ok" and status["blades"] == 1, status
        counts = [status[name] for name in ("frames", "skipped_frames", "dropped_frames")]
        assert all(isinstance(count, int) and count >= 0 for count in counts), status
        library = call("GetLibrary", after=0)
        assert library["blades"] == 1 and library["size"] > 64, library
        seen = call("GetPreview", after=0)
        assert seen["state"] in ("waiting", "settling") and seen["size"] > 160, seen
        refused("io.sward.Station.InvalidSequence", station.GetPreview, after=-1)
        read_preview(client)
        assert call("SetMix", name="fern", mix=2.5) is not None
        call("RenameBlade", name="fern", new_name="moss")
        blades = call("ListBlades")["blades"]
        assert [(blade["name"], blade["mix"]) for blade in blades] == [("moss", 2.5)], blades
        call("RemoveBlade", name="moss")
        assert call("ListBlades")["blades"] == []
        earlier = call("ListHistory", name="fern")["earlier"]
        assert [(it.get("renamed_to"), it["blade"]["mix"]) for it in earlier] == [("moss", 2.5), (None, 1)], earlier
        assert [it["back"] for it in earlier] == [1, 2], earlier
        removed = call("ListRemoved")["removed"]
        assert [(it["blade"]["name"], it["back"]) for it in removed] == [("moss", 1)], removed
        refused("io.sward.Station.NothingToRestore", station.RestoreBlade, name="moss", back=9)
        refused("org.varlink.service.InvalidParameter", station.RestoreBlade, name="moss", back=0)
        call("RestoreBlade", name="moss", back=1)
        assert call("GetLibrary", after=library["generation"])["generation"] > library["generation"]
        text = "format = 1\nknots = [\n"
        for y in (0.0, 0.1, 0.2):
            text += f"  {{ position_m = [0.0, {y}, 0.0], half_width_m = [0.004, 0.003] }},\n"
        call("PutBlade", name="drawn", text=text + "]\n")
        assert "drawn" in [blade["name"] for blade in call("ListBlades")["blades"]]
        refused("io.sward.Station.FileRefused", station.PutBlade, name="drawn", text="format = 1\nknots = 7\n")
        refused("io.sward.Station.InvalidName", station.PutBlade, name="a/b", text=text + "]\n")
        name = call("StartRecording")["name"]
        refused("io.sward.Station.BeingWritten", station.StartRecording)
        while not call("GetStatus")["status"]["recorded_frames"]:
            pass
        end = call("StopRecording")
        assert end["name"] == name and end["frames"] > 0 and end["bytes"] > 0, end
        refused("io.sward.Station.NotRecording", station.StopRecording)
        call("PinRecording", name=name, pinned=True)
        recordings = call("ListRecordings")["recordings"]
        assert [(it["name"], it["pinned"], it["writing"]) for it in recordings] == [(name, True, False)], recordings
        call("RemoveRecording", name=name)
        refused("io.sward.Station.NoSuchRecording", station.RemoveRecording, name=name)
        assert call("SaveRecording")["name"].endswith("-saved")
        assert call("Reload") == {"changed": [], "restart": []}
        refused("io.sward.Station.NoSuchBlade", station.RemoveBlade, name="heather")
        refused("io.sward.Station.NameTaken", station.RenameBlade, name="moss", new_name="moss")
        while True:
            try:
                names = call("Capture")["names"]
                break
            except varlink.VarlinkError as error:
                assert error.error() == "io.sward.Station.NothingHeld", error
        assert len(names) > 0
        assert methods <= called, methods - called
        assert len(called) == 19, called


main()
