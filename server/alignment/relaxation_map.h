// What a relaxation knows of the map: a copy, so that it can go on while the map changes.
#ifndef PORTOLAN_SERVER_ALIGNMENT_RELAXATION_MAP_H_
#define PORTOLAN_SERVER_ALIGNMENT_RELAXATION_MAP_H_

#include <map>
#include <unordered_map>
#include <vector>

#include "server/alignment/map_model.h"
#include "server/alignment/relaxation_elements.h"

namespace portolan {

class RelaxationMap {
 public:
  // Copies the submaps (of one component) and the places of the landmarks.
  RelaxationMap(const MapModel& model, const std::vector<SubmapId>& submaps);

  // Takes all landmarks of the submaps, or `max_landmarks` of each: those that most submaps see,
  // and every few of the others. A few submaps a call, until it returns true; the model may have
  // changed since the last one, what came since takes no part.
  bool AddSomePoints(const MapModel& model, size_t max_landmarks);

  std::vector<RelaxationBody>& bodies() { return bodies_; }
  const std::vector<RelaxationBody>& bodies() const { return bodies_; }
  std::vector<RelaxationPoint>& points() { return points_; }
  const std::vector<RelaxationSight>& sights() const { return sights_; }
  int node_count() const { return node_count_; }  // starts by body, then the ends of sessions
  int BodyOf(SubmapId id) const { return body_of_.at(id); }

  // From the cameras as they are now.
  void UpdateFrames();

  // Moves the model's submaps as these moved: cameras, and landmarks, whether or not they took
  // part. Returns how the world about the end of each moved.
  std::map<SubmapId, Similarity3> ApplyTo(MapModel* model) const;

 private:
  void AddBodies(const MapModel& model, const std::vector<SubmapId>& submaps);
  std::vector<int> Selected(const MapModel& model, const RelaxationBody& body,
                            size_t max_landmarks) const;
  void AddPoint(const MapModel& model, int landmark);

  std::vector<RelaxationBody> bodies_;
  std::vector<RelaxationPoint> points_;
  std::vector<RelaxationSight> sights_;
  std::unordered_map<SubmapId, int> body_of_;
  int node_count_ = 0;
  // While points are added: by landmark, what it was and where, and whether it was taken; the next
  // submap.
  std::vector<LandmarkSight> oldest_sight_at_start_;  // another one: the slot is another landmark's
  std::vector<Eigen::Vector3d> place_at_start_;
  std::vector<char> taken_;
  size_t next_body_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_RELAXATION_MAP_H_
