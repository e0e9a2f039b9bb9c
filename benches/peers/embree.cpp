// Embree on the rays of a file that `foveate bench --export` wrote (its layout: src/speed/export.rs).
//
//     embree FILE [CONFIG]      CONFIG as rtcNewDevice takes it, such as frequency_level=simd512
//
// Reads one command a line from standard input, and answers each with one line. `build QUALITY` (low,
// medium, high) builds the tree: milliseconds and bytes. `intersect KIND WIDTH FLAG` and
// `occluded KIND WIDTH FLAG` trace all rays of a kind (pixels, samples, bundles) 1, 4, 8 or 16 at a time with
// Embree's coherent or incoherent flag: wall and processor milliseconds, and how many answers are not the file's.
#include <embree4/rtcore.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <iostream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

struct Float3 {
    float x, y, z;
};

struct Input {
    uint32_t vertices, triangles, pixels, samples, bundles;
    Float3 eye;
    std::vector<Float3> positions, pixel_rays, sample_rays, origins, bundle_rays;
    std::vector<uint32_t> indices, hidden;
    std::vector<float> pixel_t, sample_t, bundle_t;
};

[[noreturn]] static void fail(const std::string &what)
{
    std::cerr << "embree: " << what << "\n";
    std::exit(1);
}

template <class T> static void read(FILE *file, std::vector<T> &to, size_t count)
{
    // Embree loads 16 bytes at the last vertex.
    to.resize(count + 2);
    if (count && fread(to.data(), sizeof(T), count, file) != count)
        fail("the file is too short");
}

static Input load(const char *path)
{
    FILE *file = fopen(path, "rb");
    char magic[8];
    Input in;
    if (!file || fread(magic, 1, 8, file) != 8 || memcmp(magic, "FVRAYS01", 8) || fread(&in, 4, 5, file) != 5 ||
        fread(&in.eye, 4, 3, file) != 3)
        fail(std::string(path) + " was not written by foveate bench --export");
    read(file, in.positions, in.vertices);
    read(file, in.indices, 3ull * in.triangles);
    read(file, in.pixel_rays, in.pixels);
    read(file, in.sample_rays, in.samples);
    read(file, in.origins, in.bundles);
    read(file, in.bundle_rays, 32ull * in.bundles);
    read(file, in.pixel_t, in.pixels);
    read(file, in.sample_t, in.samples);
    read(file, in.hidden, in.bundles);
    read(file, in.bundle_t, 32ull * in.bundles);
    fclose(file);
    return in;
}

static double seconds(clockid_t clock)
{
    timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

// Rays of one kind: ray i leaves origins[i / 32], or the eye.
struct Rays {
    const Input *in;
    const Float3 *directions;
    const float *distances;
    bool bundles;
    size_t count;

    Float3 origin(size_t i) const { return bundles ? in->origins[i / 32] : in->eye; }
};

template <int N> struct Packet;
template <> struct Packet<4> {
    using Hit = RTCRayHit4;
    static void intersect(const int *v, RTCScene s, Hit *r, RTCIntersectArguments *a) { rtcIntersect4(v, s, r, a); }
    static void occluded(const int *v, RTCScene s, Hit *r, RTCOccludedArguments *a) { rtcOccluded4(v, s, &r->ray, a); }
};
template <> struct Packet<8> {
    using Hit = RTCRayHit8;
    static void intersect(const int *v, RTCScene s, Hit *r, RTCIntersectArguments *a) { rtcIntersect8(v, s, r, a); }
    static void occluded(const int *v, RTCScene s, Hit *r, RTCOccludedArguments *a) { rtcOccluded8(v, s, &r->ray, a); }
};
template <> struct Packet<16> {
    using Hit = RTCRayHit16;
    static void intersect(const int *v, RTCScene s, Hit *r, RTCIntersectArguments *a) { rtcIntersect16(v, s, r, a); }
    static void occluded(const int *v, RTCScene s, Hit *r, RTCOccludedArguments *a) { rtcOccluded16(v, s, &r->ray, a); }
};

static bool differs(const Rays &rays, size_t i, bool occluded, float t)
{
    if (occluded) {
        bool hidden = rays.bundles ? rays.in->hidden[i / 32] >> (i % 32) & 1 : std::isfinite(rays.distances[i]);
        return hidden != (t < 0);
    }
    float ours = rays.distances[i];
    if (!std::isfinite(ours) || !std::isfinite(t))
        return std::isfinite(ours) != std::isfinite(t);
    return std::fabs(ours - t) > 1e-4f * std::fmax(ours, t);
}

template <int N>
static size_t trace(RTCScene scene, const Rays &rays, bool occluded, RTCRayQueryFlags flags, size_t from, size_t to)
{
    RTCIntersectArguments intersect;
    rtcInitIntersectArguments(&intersect);
    intersect.flags = flags;
    RTCOccludedArguments occlude;
    rtcInitOccludedArguments(&occlude);
    occlude.flags = flags;
    size_t wrong = 0;
    for (size_t i = from; i < to; i += N) {
        if constexpr (N == 1) {
            Float3 o = rays.origin(i), d = rays.directions[i];
            RTCRayHit r{};
            r.ray = {o.x, o.y, o.z, 0, d.x, d.y, d.z, 0, INFINITY, 0xffffffffu, 0, 0};
            r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
            if (occluded)
                rtcOccluded1(scene, &r.ray, &occlude);
            else
                rtcIntersect1(scene, &r, &intersect);
            wrong += differs(rays, i, occluded, r.ray.tfar);
        } else {
            alignas(64) int valid[N];
            alignas(64) typename Packet<N>::Hit r;
            for (int k = 0; k < N; ++k) {
                size_t ray = i + k < to ? i + k : to - 1;
                Float3 o = rays.origin(ray), d = rays.directions[ray];
                valid[k] = i + k < to ? -1 : 0;
                r.ray.org_x[k] = o.x, r.ray.org_y[k] = o.y, r.ray.org_z[k] = o.z;
                r.ray.dir_x[k] = d.x, r.ray.dir_y[k] = d.y, r.ray.dir_z[k] = d.z;
                r.ray.tnear[k] = 0, r.ray.tfar[k] = INFINITY, r.ray.time[k] = 0;
                r.ray.mask[k] = 0xffffffffu, r.ray.id[k] = 0, r.ray.flags[k] = 0;
                r.hit.geomID[k] = r.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
            }
            if (occluded)
                Packet<N>::occluded(valid, scene, &r, &occlude);
            else
                Packet<N>::intersect(valid, scene, &r, &intersect);
            for (int k = 0; k < N && i + k < to; ++k)
                wrong += differs(rays, i + k, occluded, r.ray.tfar[k]);
        }
    }
    return wrong;
}

static size_t trace_all(RTCScene scene, const Rays &rays, bool occluded, int width, RTCRayQueryFlags flags)
{
    constexpr size_t chunk = 1024;
    std::atomic<size_t> next{0}, wrong{0};
    auto work = [&] {
        for (;;) {
            size_t from = next.fetch_add(chunk), to = std::min(from + chunk, rays.count);
            if (from >= rays.count)
                return;
            wrong += width == 1   ? trace<1>(scene, rays, occluded, flags, from, to)
                     : width == 4 ? trace<4>(scene, rays, occluded, flags, from, to)
                     : width == 8 ? trace<8>(scene, rays, occluded, flags, from, to)
                                  : trace<16>(scene, rays, occluded, flags, from, to);
        }
    };
    std::vector<std::thread> threads;
    for (unsigned i = 1; i < std::max(1u, std::thread::hardware_concurrency()); ++i)
        threads.emplace_back(work);
    work();
    for (std::thread &thread : threads)
        thread.join();
    return wrong;
}

static std::atomic<long long> memory{0};

static RTCScene build(RTCDevice device, const Input &in, RTCBuildQuality quality)
{
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, quality);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryBuildQuality(geometry, quality);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, in.positions.data(), 0, 12,
                               in.vertices);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, in.indices.data(), 0, 12,
                               in.triangles);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

int main(int argc, char **argv)
{
    if (argc < 2)
        fail("give the file that foveate bench --export wrote");
    Input in = load(argv[1]);
    RTCDevice device = rtcNewDevice(argc > 2 ? argv[2] : nullptr);
    if (!device)
        fail("no device with this configuration");
    rtcSetDeviceMemoryMonitorFunction(
        device, [](void *, ssize_t bytes, bool) { memory += bytes; return true; }, nullptr);
    RTCScene scene = nullptr;
    std::string line;
    while (std::getline(std::cin, line)) {
        std::istringstream words(line);
        std::string what, kind, flag;
        int width = 1;
        words >> what >> kind >> width >> flag;
        double wall = seconds(CLOCK_MONOTONIC), cpu = seconds(CLOCK_PROCESS_CPUTIME_ID);
        if (what == "build") {
            if (scene)
                rtcReleaseScene(scene);
            scene = build(device, in,
                          kind == "low"    ? RTC_BUILD_QUALITY_LOW
                          : kind == "high" ? RTC_BUILD_QUALITY_HIGH
                                           : RTC_BUILD_QUALITY_MEDIUM);
            printf("%.3f %lld\n", (seconds(CLOCK_MONOTONIC) - wall) * 1e3, memory.load());
        } else {
            Rays rays = kind == "pixels"    ? Rays{&in, in.pixel_rays.data(), in.pixel_t.data(), false, in.pixels}
                        : kind == "samples" ? Rays{&in, in.sample_rays.data(), in.sample_t.data(), false, in.samples}
                                            : Rays{&in, in.bundle_rays.data(), in.bundle_t.data(), true, 32ull * in.bundles};
            RTCRayQueryFlags flags = flag == "coherent" ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
            if (!scene)
                fail("build comes first");
            size_t wrong = trace_all(scene, rays, what == "occluded", width, flags);
            printf("%.4f %.4f %zu\n", (seconds(CLOCK_MONOTONIC) - wall) * 1e3,
                   (seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu) * 1e3, wrong);
        }
        fflush(stdout);
    }
}
