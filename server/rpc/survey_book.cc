#include "server/rpc/survey_book.h"

#include <algorithm>
#include <utility>

#include "common/base/concat.h"

namespace portolan {
namespace {

auto PlaceOfPoint(std::vector<ControlPoint>* points, const std::string& id) {
  return std::lower_bound(
      points->begin(), points->end(), id,
      [](const ControlPoint& point, const std::string& other) { return point.id < other; });
}

// What the operator can still mend.
Status CheckPlaces(const Survey& survey) {
  const std::optional<SiteOrigin> origin = ImpliedOrigin(survey);
  for (const ControlPoint& point : survey.points) {
    const auto in_site = PositionInSite(*origin, point);
    if (in_site.ok()) continue;
    return Status(in_site.status().code(),
                  Concat("control point ", point.id, " ", in_site.status().message()));
  }
  return absl::OkStatus();
}

}  // namespace

SurveyBook::SurveyBook(Survey survey, MapStore* store, MapThread* map_thread)
    : store_(store),
      map_thread_(map_thread),
      survey_(std::make_shared<const Survey>(std::move(survey))) {}

std::shared_ptr<const Survey> SurveyBook::Get() const {
  const std::lock_guard lock(mutex_);
  return survey_;
}

Status SurveyBook::Replace(Survey survey) {
  if (survey.points.size() > kMaxControlPoints) {
    return absl::ResourceExhaustedError(
        Concat("a map has at most ", kMaxControlPoints, " control points"));
  }
  PORTOLAN_RETURN_IF_ERROR(CheckPlaces(survey));
  PORTOLAN_RETURN_IF_ERROR(store_->SaveSurvey(survey));
  survey_ = std::make_shared<const Survey>(std::move(survey));
  map_thread_->SetSurvey(survey_);
  return absl::OkStatus();
}

Status SurveyBook::Add(std::vector<ControlPoint> points, bool replace) {
  const std::lock_guard lock(mutex_);
  Survey survey = *survey_;
  for (ControlPoint& point : points) {
    const auto place = PlaceOfPoint(&survey.points, point.id);
    const bool is_known = place != survey.points.end() && place->id == point.id;
    if (is_known && !replace) {
      return absl::AlreadyExistsError(Concat("control point ", point.id, " is there already"));
    }
    if (is_known) {
      *place = std::move(point);
    } else {
      survey.points.insert(place, std::move(point));
    }
  }
  return Replace(std::move(survey));
}

Status SurveyBook::Remove(const std::vector<std::string>& ids) {
  const std::lock_guard lock(mutex_);
  Survey survey = *survey_;
  for (const std::string& id : ids) {
    const auto place = PlaceOfPoint(&survey.points, id);
    if (place == survey.points.end() || place->id != id) {
      return absl::NotFoundError(Concat("there is no control point ", id));
    }
    survey.points.erase(place);
  }
  return Replace(std::move(survey));
}

Status SurveyBook::SetOrigin(const std::optional<SiteOrigin>& origin) {
  const std::lock_guard lock(mutex_);
  Survey survey = *survey_;
  survey.origin = origin;
  return Replace(std::move(survey));
}

}  // namespace portolan
