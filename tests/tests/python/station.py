"""Calls every method of io.sward.Station with the public varlink package. Arguments: the socket, and
what to do: `check` says whether the package is there, `call` calls."""

import sys


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
        assert call("SetMix", name="fern", mix=2.5) is not None
        call("RenameBlade", name="fern", new_name="moss")
        blades = call("ListBlades")["blades"]
        assert [(blade["name"], blade["mix"]) for blade in blades] == [("moss", 2.5)], blades
        call("RemoveBlade", name="moss")
        assert call("ListBlades")["blades"] == []
        call("RestoreBlade", name="moss")
        assert call("GetLibrary", after=library["generation"])["generation"] > library["generation"]
        text = "format = 1\nknots = [\n"
        for y in (0.0, 0.1, 0.2):
            text += f"  {{ position_m = [0.0, {y}, 0.0], half_width_m = [0.004, 0.003] }},\n"
        call("PutBlade", name="drawn", text=text + "]\n")
        assert "drawn" in [blade["name"] for blade in call("ListBlades")["blades"]]
        refused("io.sward.Station.FileRefused", station.PutBlade, name="drawn", text="format = 1\nknots = 7\n")
        refused("io.sward.Station.InvalidName", station.PutBlade, name="a/b", text=text + "]\n")
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
        assert len(called) == 10, called


main()
