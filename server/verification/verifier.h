// Geometric verification of a place candidate: are two submaps views of the same place, and how do
// they lie to each other?
#ifndef PORTOLAN_SERVER_VERIFICATION_VERIFIER_H_
#define PORTOLAN_SERVER_VERIFICATION_VERIFIER_H_

#include <optional>
#include <string>

#include "common/base/status.h"
#include "server/refinement/refined_submap.h"
#include "server/verification/closure.h"

namespace portolan {

struct VerifierOptions {
  Status Validate() const;
};

// Why a pair was refused and how far it came; for logs and metrics.
struct VerificationReport {
  // Empty if accepted, else one of a few fixed phrases.
  std::string refusal;
  int putative_matches = 0;
  int ransac_inliers = 0;
  int inliers = 0;
};

// Thread rule: immutable after creation, hence thread-safe. Deterministic: the answer depends on
// the two submaps and the options only.
class Verifier {
 public:
  static StatusOr<Verifier> Create(const VerifierOptions& options);

  // The verified relation, or no value if the submaps do not certainly show the same place. Every
  // LandmarkMatch names tracks that have a landmark in both submaps; no track appears twice. If
  // both submaps are metric the scale is exactly 1 and its information is that of a constant.
  std::optional<Closure> Verify(const RefinedSubmap& a, const RefinedSubmap& b,
                                VerificationReport* report = nullptr) const;

 private:
  explicit Verifier(const VerifierOptions& options) : options_(options) {}

  VerifierOptions options_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_VERIFIER_H_
