#include "server/alignment/relaxation_positions.h"

#include <array>
#include <cmath>

#include "common/linear_algebra/dense.h"

namespace portolan {

void RelaxationPositions::Add(int body, const RelaxationBody& element, const PositionTerm& term) {
  Element added;
  added.body = body;
  added.part =
      element.last_keyframe == 0 ? 0.0 : term.keyframe / static_cast<double>(element.last_keyframe);
  added.place = term.point.in_world;
  added.target = term.point.in_site;
  const Eigen::Matrix3d covariance = term.point.site_covariance + term.point.world_covariance;
  added.information = InverseOfPositiveDefinite(covariance);
  added.share = term.point.share;
  elements_.push_back(added);
}

void RelaxationPositions::ChooseLoss(const GeoreferenceFitOptions& options) {
  std::vector<double> chi2;
  for (const Element& element : elements_) chi2.push_back(element.Chi2(element.place));
  loss_square_ = SiteLossSquare(options, chi2);
}

double RelaxationPositions::Cost() const {
  double cost = 0;
  for (const Element& element : elements_) {
    cost +=
        0.5 * element.share * loss_square_ * std::log1p(element.Chi2(element.place) / loss_square_);
  }
  return cost;
}

void RelaxationPositions::AddTo(const std::vector<RelaxationBody>& bodies,
                                BlockSystem* system) const {
  for (const Element& element : elements_) {
    const RelaxationBody& body = bodies[element.body];
    const Eigen::Vector3d error = element.place - element.target;
    const double weight = 1 / (1 + element.Chi2(element.place) / loss_square_);
    const Eigen::Matrix3d information = weight * element.share * element.information;
    const auto jacobians = PointJacobians(body, element.place);
    const std::array<double, 2> shares = {1 - element.part, element.part};
    for (int row = 0; row < 2; ++row) {
      const Eigen::Matrix<double, 7, 3> left =
          shares[row] * jacobians[row].transpose() * information;
      system->gradient().segment<7>(7 * body.nodes[row]) += left * error;
      for (int column = 0; column < 2; ++column) {
        if (body.nodes[row] < body.nodes[column]) continue;
        system->Block(body.nodes[row], body.nodes[column]) +=
            shares[column] * left * jacobians[column];
      }
    }
  }
}

void RelaxationPositions::Try(const std::function<Similarity3(int body, double part)>& change) {
  for (Element& element : elements_) {
    element.tried = change(element.body, element.part) * element.place;
  }
}

double RelaxationPositions::CostOfTrial() const {
  double cost = 0;
  for (const Element& element : elements_) {
    cost +=
        0.5 * element.share * loss_square_ * std::log1p(element.Chi2(element.tried) / loss_square_);
  }
  return cost;
}

void RelaxationPositions::AcceptTrial() {
  for (Element& element : elements_) element.place = element.tried;
}

}  // namespace portolan
