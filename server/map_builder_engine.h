// The map builder as the engine of the map thread.
#ifndef PORTOLAN_SERVER_MAP_BUILDER_ENGINE_H_
#define PORTOLAN_SERVER_MAP_BUILDER_ENGINE_H_

#include <memory>

#include "server/map_builder.h"
#include "server/pipeline/map_engine.h"

namespace portolan {

StatusOr<std::unique_ptr<MapEngine>> MakeMapBuilderEngine(const MapBuilderOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_MAP_BUILDER_ENGINE_H_
