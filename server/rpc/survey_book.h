// The control points of the map: changes go to the disk first, then to the map thread.
#ifndef PORTOLAN_SERVER_RPC_SURVEY_BOOK_H_
#define PORTOLAN_SERVER_RPC_SURVEY_BOOK_H_

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/georeference/survey.h"
#include "server/pipeline/map_thread.h"
#include "server/store/map_store.h"

namespace portolan {

// Thread-safe; a change waits for the disk. Store and map thread outlive it.
class SurveyBook {
 public:
  // `survey`: as stored.
  SurveyBook(Survey survey, MapStore* store, MapThread* map_thread);

  std::shared_ptr<const Survey> Get() const;
  // All or none. AlreadyExists for a known id unless `replace`; ResourceExhausted for too many;
  // FailedPrecondition for a point that has no place in the site's frame. Valid points only.
  Status Add(std::vector<ControlPoint> points, bool replace);
  // NotFound for an unknown id.
  Status Remove(const std::vector<std::string>& ids);
  Status SetOrigin(const std::optional<SiteOrigin>& origin);

 private:
  // Under the lock.
  Status Replace(Survey survey);

  MapStore* const store_;
  MapThread* const map_thread_;
  mutable std::mutex mutex_;
  std::shared_ptr<const Survey> survey_;  // guarded by mutex_
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_SURVEY_BOOK_H_
