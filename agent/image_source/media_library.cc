#include "agent/image_source/media_library.h"

#include <dlfcn.h>

#include "common/base/concat.h"

namespace portolan {
namespace {

constexpr char kLibrary[] = "portolan-media.so";

StatusOr<MediaLibrary*> Load() {
  // Searched for in the program's run path, which has the program's own folder.
  void* library = dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  void* get = library == nullptr ? nullptr : dlsym(library, "PortolanMediaLibrary");
  if (get == nullptr) {
    return absl::FailedPreconditionError(
        Concat("videos, cameras and images other than PNG and JPEG need ", kLibrary,
               " beside the program: ", std::string(dlerror())));
  }
  return reinterpret_cast<MediaLibrary* (*)()>(get)();
}

}  // namespace

StatusOr<MediaLibrary*> LoadMediaLibrary() {
  static const StatusOr<MediaLibrary*>* const library = new StatusOr<MediaLibrary*>(Load());
  return *library;
}

}  // namespace portolan
