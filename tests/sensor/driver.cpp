// A driver of OpenNI2 for tests, loaded by the real library: every file in the folder `sensors` beside the library is a
// sensor that is plugged in, and its name the port. Removing the file unplugs it. What it is and does stands in it as
// words: width=640 height=480 fps=30 unit=100 (100: 1 mm, 101: 0.1 mm) serial=text and, counted in frames from its
// start, stall=N (silent from then on), crash=N, skip=N (one frame is lost there); hang=1 (opening takes for ever).
//
// Pixel (x, y) of frame k, from 0, is 400 + (7k + 3x + 5y) mod 8000, and 0 where x + y + k is a multiple of 97; left and
// right are exchanged until it is told otherwise, as such sensors do.

#include <dirent.h>
#include <dlfcn.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <thread>

#define XN_NEW(type, ...) new type(__VA_ARGS__)
#define XN_DELETE(p) delete (p)
#include <Driver/OniDriverAPI.h>

namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

struct Sensor {
    OniDeviceInfo info{};
    std::map<std::string, std::string> words;
    std::atomic<bool> is_plugged{true};

    int number(const char* word, int otherwise) const {
        auto found = words.find(word);
        return found == words.end() ? otherwise : std::atoi(found->second.c_str());
    }
};

OniStatus give(const void* value, size_t bytes, void* data, int* size) {
    if (*size < static_cast<int>(bytes)) return ONI_STATUS_BAD_PARAMETER;
    std::memcpy(data, value, bytes);
    *size = static_cast<int>(bytes);
    return ONI_STATUS_OK;
}

class Stream : public oni::driver::StreamBase {
public:
    explicit Stream(Sensor& sensor) : sensor_(sensor), mode_(modes(sensor)[0]) {}
    ~Stream() override { stop(); }

    // The sensor's own mode, and a quarter of its pixels at twice the rate.
    static std::array<OniVideoMode, 2> modes(const Sensor& sensor) {
        int width = sensor.number("width", 640), height = sensor.number("height", 480), fps = sensor.number("fps", 30);
        auto format = static_cast<OniPixelFormat>(sensor.number("unit", ONI_PIXEL_FORMAT_DEPTH_1_MM));
        return {OniVideoMode{format, width, height, fps}, OniVideoMode{format, width / 2, height / 2, 2 * fps}};
    }

    OniBool isPropertySupported(int id) override {
        return id == ONI_STREAM_PROPERTY_VIDEO_MODE || id == ONI_STREAM_PROPERTY_HORIZONTAL_FOV ||
               id == ONI_STREAM_PROPERTY_VERTICAL_FOV || id == ONI_STREAM_PROPERTY_MIRRORING ||
               id == ONI_STREAM_PROPERTY_MAX_VALUE;
    }

    OniStatus getProperty(int id, void* data, int* size) override {
        const float across = 1.0225999f, down = 0.79661566f;
        const int most = 10000, mirrored = is_mirrored_;
        switch (id) {
            case ONI_STREAM_PROPERTY_VIDEO_MODE: return give(&mode_, sizeof mode_, data, size);
            case ONI_STREAM_PROPERTY_HORIZONTAL_FOV: return give(&across, sizeof across, data, size);
            case ONI_STREAM_PROPERTY_VERTICAL_FOV: return give(&down, sizeof down, data, size);
            case ONI_STREAM_PROPERTY_MIRRORING: return give(&mirrored, sizeof mirrored, data, size);
            case ONI_STREAM_PROPERTY_MAX_VALUE: return give(&most, sizeof most, data, size);
            default: return ONI_STATUS_NOT_IMPLEMENTED;
        }
    }

    OniStatus setProperty(int id, const void* data, int) override {
        if (id == ONI_STREAM_PROPERTY_VIDEO_MODE) {
            mode_ = *static_cast<const OniVideoMode*>(data);
        } else if (id == ONI_STREAM_PROPERTY_MIRRORING) {
            is_mirrored_ = *static_cast<const int*>(data);
        } else {
            return ONI_STATUS_NOT_IMPLEMENTED;
        }
        return ONI_STATUS_OK;
    }

    int getRequiredFrameSize() override { return mode_.resolutionX * mode_.resolutionY * 2; }

    OniStatus start() override {
        is_running_ = true;
        thread_ = std::thread([this] { run(); });
        return ONI_STATUS_OK;
    }

    void stop() override {
        is_running_ = false;
        if (thread_.joinable()) thread_.join();
    }

private:
    void run() {
        const auto begin = Clock::now();
        const int stall = sensor_.number("stall", -1), crash = sensor_.number("crash", -1);
        const int skip = sensor_.number("skip", -1);
        for (int k = 0; is_running_ && sensor_.is_plugged && k != stall; ++k) {
            const long long due_us = 1000000LL * k / mode_.fps;
            std::this_thread::sleep_until(begin + std::chrono::microseconds(due_us));
            if (k == crash) std::abort();
            if (k == skip) continue;
            OniFrame* frame = getServices().acquireFrame();
            if (frame == nullptr) continue;
            fill(*frame, k, due_us);
            raiseNewFrame(frame);
            getServices().releaseFrame(frame);
        }
    }

    void fill(OniFrame& frame, int k, long long due_us) const {
        const int width = mode_.resolutionX, height = mode_.resolutionY;
        auto* pixels = static_cast<uint16_t*>(frame.data);
        for (int y = 0; y < height; ++y) {
            for (int x = 0; x < width; ++x) {
                const int seen = is_mirrored_ ? width - 1 - x : x;
                const bool is_read = (seen + y + k) % 97 != 0;
                pixels[y * width + x] = is_read ? 400 + (7 * k + 3 * seen + 5 * y) % 8000 : 0;
            }
        }
        frame.dataSize = width * height * 2;
        frame.sensorType = ONI_SENSOR_DEPTH;
        frame.timestamp = due_us;
        frame.frameIndex = k + 1;
        frame.width = width;
        frame.height = height;
        frame.videoMode = mode_;
        frame.croppingEnabled = FALSE;
        frame.cropOriginX = frame.cropOriginY = 0;
        frame.stride = width * 2;
    }

    Sensor& sensor_;
    OniVideoMode mode_;
    std::atomic<int> is_mirrored_{1};
    std::atomic<bool> is_running_{false};
    std::thread thread_;
};

class Device : public oni::driver::DeviceBase {
public:
    explicit Device(Sensor& sensor) : sensor_(sensor), modes_(Stream::modes(sensor)) {
        info_ = OniSensorInfo{ONI_SENSOR_DEPTH, static_cast<int>(modes_.size()), modes_.data()};
    }

    OniStatus getSensorInfoList(OniSensorInfo** infos, int* count) override {
        *infos = &info_;
        *count = 1;
        return ONI_STATUS_OK;
    }

    oni::driver::StreamBase* createStream(OniSensorType type) override {
        return type == ONI_SENSOR_DEPTH ? new Stream(sensor_) : nullptr;
    }

    void destroyStream(oni::driver::StreamBase* stream) override { delete stream; }

    OniBool isPropertySupported(int id) override { return id == ONI_DEVICE_PROPERTY_SERIAL_NUMBER; }

    OniStatus getProperty(int id, void* data, int* size) override {
        auto serial = sensor_.words.find("serial");
        if (id != ONI_DEVICE_PROPERTY_SERIAL_NUMBER || serial == sensor_.words.end()) return ONI_STATUS_NOT_IMPLEMENTED;
        return give(serial->second.c_str(), serial->second.size() + 1, data, size);
    }

private:
    Sensor& sensor_;
    std::array<OniVideoMode, 2> modes_;
    OniSensorInfo info_{};
};

class Driver : public oni::driver::DriverBase {
public:
    explicit Driver(OniDriverServices* services) : DriverBase(services) {}

    OniStatus initialize(oni::driver::DeviceConnectedCallback connected,
                         oni::driver::DeviceDisconnectedCallback disconnected,
                         oni::driver::DeviceStateChangedCallback changed, void* cookie) override {
        DriverBase::initialize(connected, disconnected, changed, cookie);
        Dl_info own{};
        dladdr(reinterpret_cast<void*>(&give), &own);
        // <folder>/OpenNI2/Drivers/<this>.so.0
        folder_ = own.dli_fname;
        for (int up = 0; up < 3; ++up) folder_.erase(folder_.rfind('/'));
        folder_ += "/sensors";
        look();
        thread_ = std::thread([this] {
            while (is_running_) {
                std::this_thread::sleep_for(milliseconds(20));
                look();
            }
        });
        return ONI_STATUS_OK;
    }

    void shutdown() override {
        is_running_ = false;
        if (thread_.joinable()) thread_.join();
    }

    OniStatus tryDevice(const char* uri) override { return find(uri) ? ONI_STATUS_OK : ONI_STATUS_ERROR; }

    oni::driver::DeviceBase* deviceOpen(const char* uri, const char*) override {
        Sensor* sensor = find(uri);
        if (sensor == nullptr) return nullptr;
        while (sensor->number("hang", 0) != 0) std::this_thread::sleep_for(milliseconds(100));
        return new Device(*sensor);
    }

    void deviceClose(oni::driver::DeviceBase* device) override { delete device; }

private:
    Sensor* find(const std::string& uri) {
        std::lock_guard<std::mutex> lock(mutex_);
        auto found = plugged_.find(uri);
        return found == plugged_.end() ? nullptr : found->second;
    }

    // Plugs in what is new in the folder, and unplugs what is gone. A sensor stays in memory: it may still be open.
    void look() {
        std::set<std::string> seen;
        if (DIR* folder = opendir(folder_.c_str())) {
            while (dirent* entry = readdir(folder)) {
                if (entry->d_name[0] != '.') seen.insert(entry->d_name);
            }
            closedir(folder);
        }
        for (const std::string& port : seen) {
            const std::string uri = "sward/0001@" + port;
            if (find(uri) != nullptr) continue;
            auto* sensor = new Sensor;
            std::ifstream file(folder_ + "/" + port);
            for (std::string word; file >> word;) {
                const size_t equals = word.find('=');
                if (equals != std::string::npos) sensor->words[word.substr(0, equals)] = word.substr(equals + 1);
            }
            std::strncpy(sensor->info.uri, uri.c_str(), ONI_MAX_STR - 1);
            std::strncpy(sensor->info.vendor, "Sward", ONI_MAX_STR - 1);
            std::strncpy(sensor->info.name, "Test", ONI_MAX_STR - 1);
            sensor->info.usbVendorId = 0x5a5a;
            sensor->info.usbProductId = 1;
            {
                std::lock_guard<std::mutex> lock(mutex_);
                plugged_[uri] = sensor;
            }
            deviceConnected(&sensor->info);
        }
        std::map<std::string, Sensor*> gone;
        {
            std::lock_guard<std::mutex> lock(mutex_);
            for (const auto& [uri, sensor] : plugged_) {
                if (seen.count(uri.substr(uri.find('@') + 1)) == 0) gone[uri] = sensor;
            }
            for (const auto& [uri, sensor] : gone) plugged_.erase(uri);
        }
        for (const auto& [uri, sensor] : gone) {
            sensor->is_plugged = false;
            deviceDisconnected(&sensor->info);
        }
    }

    std::string folder_;
    std::mutex mutex_;
    std::map<std::string, Sensor*> plugged_;
    std::atomic<bool> is_running_{true};
    std::thread thread_;
};

}  // namespace

ONI_EXPORT_DRIVER(Driver)
