#include "tests/support/matchers.h"

namespace portolan {

void PrintTo(const Rigid3& rigid, std::ostream* out) {
  *out << "translation [" << rigid.translation.transpose() << "] rotation xyzw ["
       << rigid.rotation.coeffs().transpose() << "]";
}

void PrintTo(const Similarity3& similarity, std::ostream* out) {
  *out << "scale " << similarity.scale << " ";
  PrintTo(similarity.Rigid(), out);
}

}  // namespace portolan
