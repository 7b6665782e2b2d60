// Reproducible random numbers for the synthetic world: the same on every platform, unlike the
// distributions of <random>.
#ifndef PORTOLAN_TESTS_SYNTHETIC_RANDOM_H_
#define PORTOLAN_TESTS_SYNTHETIC_RANDOM_H_

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

namespace portolan::synthetic {

// SplitMix64 (Steele, Lea, Flood, OOPSLA 2014).
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}

  uint64_t Next() {
    uint64_t z = (state_ += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }
  // Uniform in [0, 1), and in [low, high).
  double Uniform() { return static_cast<double>(Next() >> 11) * 0x1.0p-53; }
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  // Uniform in 0 ... count - 1.
  int Index(int count) { return static_cast<int>(Next() % static_cast<uint64_t>(count)); }
  // Normal with mean 0 and standard deviation 1 (Box & Muller 1958).
  double Normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
    return radius * std::cos(2.0 * M_PI * Uniform());
  }
  Eigen::Vector3d Normal3() {
    const double x = Normal(), y = Normal();
    return {x, y, Normal()};
  }

 private:
  uint64_t state_;
};

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_RANDOM_H_
