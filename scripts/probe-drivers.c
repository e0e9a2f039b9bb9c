/* Ends with 0 where a driver works here: "opencl" asks for an OpenCL device, "vulkan" for a Vulkan one. Software
 * drivers older than what foveate needs (PoCL 6, Mesa 25's lavapipe) do not count, nor do Mesa's OpenCL drivers.
 * Compiled by scripts/install-packages.sh; declares what it calls itself, since headers may not be installed. */
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PLATFORM_VERSION = 0x0901, PLATFORM_NAME = 0x0902, OLDEST_POCL = 6, OLDEST_LAVAPIPE = 25 };

static int opencl(void) {
  void *loader = dlopen("libOpenCL.so.1", RTLD_NOW);
  if (!loader) return 0;
  int (*platforms)(unsigned, void **, unsigned *) = dlsym(loader, "clGetPlatformIDs");
  int (*about)(void *, unsigned, size_t, void *, size_t *) = dlsym(loader, "clGetPlatformInfo");
  int (*devices)(void *, uint64_t, unsigned, void **, unsigned *) = dlsym(loader, "clGetDeviceIDs");
  void *ids[16];
  unsigned count = 0;
  if (!platforms || !about || !devices || platforms(16, ids, &count)) return 0;
  for (unsigned i = 0; i < count && i < 16; i++) {
    char name[256] = "", version[256] = "";
    unsigned found = 0;
    void *device;
    about(ids[i], PLATFORM_NAME, sizeof name - 1, name, NULL);
    about(ids[i], PLATFORM_VERSION, sizeof version - 1, version, NULL);
    const char *pocl = strstr(version, "PoCL ");
    if (!pocl) pocl = strstr(version, "pocl ");
    if (pocl && atoi(pocl + 5) < OLDEST_POCL) continue;
    if (strstr(name, "Clover") || strstr(name, "rusticl")) continue;
    if (devices(ids[i], 0xFFFFFFFF, 1, &device, &found) == 0 && found > 0) return 1;
  }
  return 0;
}

struct application { int type; const void *next; const char *name; uint32_t version; const char *engine; uint32_t engine_version, api; };
struct creation { int type; const void *next; uint32_t flags; const struct application *application; uint32_t layers; const void *layer_names; uint32_t extensions; const void *extension_names; };
struct driver { int type; const void *next; uint32_t id; char name[256], info[256], conformance[4]; };
struct properties { int type; const void *next; uint32_t api, driver, vendor, device, kind; char name[256], rest[2048]; };

static int vulkan(void) {
  void *loader = dlopen("libvulkan.so.1", RTLD_NOW);
  if (!loader) return 0;
  int (*create)(const struct creation *, const void *, void **) = dlsym(loader, "vkCreateInstance");
  int (*devices)(void *, uint32_t *, void **) = dlsym(loader, "vkEnumeratePhysicalDevices");
  void (*about)(void *, struct properties *) = dlsym(loader, "vkGetPhysicalDeviceProperties2");
  if (!create || !devices || !about) return 0;
  struct application application = {0, NULL, "probe", 0, "probe", 0, (1u << 22) | (1u << 12)};
  struct creation creation = {1, NULL, 0, &application, 0, NULL, 0, NULL};
  void *instance, *ids[16];
  uint32_t count = 16;
  if (create(&creation, NULL, &instance) || devices(instance, &count, ids) < 0) return 0;
  for (uint32_t i = 0; i < count; i++) {
    struct driver driver = {.type = 1000196000};
    struct properties found = {.type = 1000059001, .next = &driver};
    about(ids[i], &found);
    if (found.api < ((1u << 22) | (1u << 12))) continue;
    const char *mesa = strstr(driver.info, "Mesa ");
    if (strstr(found.name, "llvmpipe") && mesa && atoi(mesa + 5) < OLDEST_LAVAPIPE) continue;
    return 1;
  }
  return 0;
}

int main(int count, char **words) {
  if (count == 2 && !strcmp(words[1], "opencl")) return !opencl();
  if (count == 2 && !strcmp(words[1], "vulkan")) return !vulkan();
  fputs("usage: probe-drivers opencl|vulkan\n", stderr);
  return 2;
}
