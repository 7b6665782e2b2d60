// The parts of the server that the RPC handlers use. All thread-safe; all outlive the handlers.
#ifndef PORTOLAN_SERVER_RPC_SERVER_CONTEXT_H_
#define PORTOLAN_SERVER_RPC_SERVER_CONTEXT_H_

#include <string>

#include "server/corrections/correction_dispatcher.h"
#include "server/ingest/ingest.h"
#include "server/ingest/session_table.h"
#include "server/pipeline/map_thread.h"
#include "server/pipeline/snapshot_hub.h"
#include "server/query/landmark_index.h"
#include "server/rpc/survey_book.h"
#include "server/store/map_store.h"

namespace portolan {

struct ServerContext {
  SnapshotHub* hub = nullptr;
  MapStore* store = nullptr;
  SessionTable* sessions = nullptr;
  Ingest* ingest = nullptr;
  MapThread* map_thread = nullptr;
  CorrectionDispatcher* corrections = nullptr;
  LandmarkIndexCache* landmarks = nullptr;
  SurveyBook* survey = nullptr;
  std::string software_version;
  // Streams of agents at the same time; more are refused with RESOURCE_EXHAUSTED.
  int max_agents = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_SERVER_CONTEXT_H_
