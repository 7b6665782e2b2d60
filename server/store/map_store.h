// Durable storage of the map: the raw submaps, which are never changed, and everything derived
// from them, which can be dropped and rebuilt.
#ifndef PORTOLAN_SERVER_STORE_MAP_STORE_H_
#define PORTOLAN_SERVER_STORE_MAP_STORE_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "common/submap/submap.h"
#include "server/fusion/map_state.h"

namespace portolan {

// One run of an agent, with the calibration of its camera.
struct SessionRecord {
  AgentId agent;
  SessionId session;
  CameraIntrinsics camera;
  // The agent said that no further submap follows.
  bool finished = false;
};

// A submap to be committed: its name and the bytes of the message that carried it.
struct NewSubmap {
  SubmapKey key;
  std::string bytes;
};

struct StoredSubmap {
  SubmapId id;
  std::shared_ptr<const Submap> submap;
  std::shared_ptr<const CameraModel> camera;
  int64_t byte_count = 0;
};

struct StoredMap {
  std::vector<SessionRecord> sessions;  // in order of their creation
  std::vector<StoredSubmap> submaps;    // ascending id
  Survey survey;
  // Null if nothing derived is stored, or if it was written by another version of the program or
  // is damaged; then derived_problem says so and the map must be rebuilt from the submaps.
  std::shared_ptr<const MapSnapshot> snapshot;
  std::string derived_problem;
};

// Axis-aligned box in the world frame of a component.
struct Box {
  Eigen::Vector3d min = Eigen::Vector3d::Zero();
  Eigen::Vector3d max = Eigen::Vector3d::Zero();
};

// Turns the bytes of a raw submap back into a value.
using SubmapDecoder = std::function<StatusOr<Submap>(std::string_view bytes)>;

// Thread-safe. A write returns OK only once its data are on the disk; after a write failed, every
// further write fails with FailedPrecondition until the store is opened anew, because nobody knows
// what the failed one left behind.
class MapStore {
 public:
  virtual ~MapStore() = default;

  // Known already with the same calibration: does nothing. With another one: FailedPrecondition.
  virtual Status AddSession(const SessionRecord& session) = 0;
  virtual Status FinishSession(const AgentId& agent, SessionId session) = 0;

  // Commits all in one transaction, in this order; the sessions must exist. AlreadyExists, and
  // nothing is written, if one of the keys is there already. Returns the new ids.
  virtual StatusOr<std::vector<SubmapId>> AppendSubmaps(const std::vector<NewSubmap>& submaps) = 0;

  // Makes the stored derived state equal to `snapshot`. Only what changed since the last save or
  // load is written, in one transaction.
  virtual Status SaveSnapshot(const MapSnapshot& snapshot) = 0;
  virtual Status DropDerived() = 0;

  // Call it before the first write. DataLoss if a raw submap cannot be read back.
  virtual StatusOr<StoredMap> Load(const SubmapDecoder& decode) = 0;

  // The stored submaps of a component, ascending, whose landmarks' bounding box touches the box.
  virtual StatusOr<std::vector<SubmapId>> SubmapsInBox(ComponentId component, const Box& box) = 0;

  // Replaces the stored control points and origin.
  virtual Status SaveSurvey(const Survey& survey) = 0;

  virtual StatusOr<int64_t> SizeBytes() = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_MAP_STORE_H_
