// A relaxation's terms of position: places that move with a part of a submap, and where they should
// be.
#ifndef PORTOLAN_SERVER_ALIGNMENT_RELAXATION_POSITIONS_H_
#define PORTOLAN_SERVER_ALIGNMENT_RELAXATION_POSITIONS_H_

#include <functional>
#include <vector>

#include "server/alignment/block_system.h"
#include "server/alignment/position_references.h"
#include "server/alignment/relaxation_elements.h"

namespace portolan {

// Protocol: Add..., then for each step ChooseLoss, Cost, AddTo, Try, CostOfTrial, AcceptTrial.
class RelaxationPositions {
 public:
  // `body` is the number of the term's submap.
  void Add(int body, const RelaxationBody& element, const PositionTerm& term);
  bool empty() const { return elements_.empty(); }

  void ChooseLoss(const GeoreferenceFitOptions& options);
  double Cost() const;
  void AddTo(const std::vector<RelaxationBody>& bodies, BlockSystem* system) const;
  // `change(body, part)`: how a step moves the world there.
  void Try(const std::function<Similarity3(int body, double part)>& change);
  double CostOfTrial() const;
  void AcceptTrial();

 private:
  struct Element {
    int body = 0;
    double part = 0;  // 0: moves with the submap's start, 1: with its end
    Eigen::Vector3d place = Eigen::Vector3d::Zero();
    Eigen::Vector3d tried = Eigen::Vector3d::Zero();
    Eigen::Vector3d target = Eigen::Vector3d::Zero();
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    double share = 1;

    double Chi2(const Eigen::Vector3d& at) const {
      return (at - target).dot(information * (at - target));
    }
  };

  std::vector<Element> elements_;
  double loss_square_ = 1;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_RELAXATION_POSITIONS_H_
