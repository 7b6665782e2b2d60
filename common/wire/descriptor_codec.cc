#include "common/wire/descriptor_codec.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <memory>

#include "absl/strings/str_cat.h"
#include "common/features/brief_pattern.h"
#include "common/wire/binary_coder.h"

namespace portolan {
namespace {

constexpr int kBits = kBriefPairs;
// Inputs of a bit's regression: earlier bits of the descriptor, its two references, a constant.
constexpr int kEarlier = 13;
constexpr int kInputs = kEarlier + 3;
constexpr int16_t kOne_q12 = 4096;
// Weights at the start: share of the geometric correlation, and the references'.
constexpr int64_t kCorrelationShare_q12 = 2867;  // 0.7
constexpr std::array<int16_t, 2> kReferenceWeights_q12 = {4096, 6144};
// Step of the learning: 13 / 2^13 of an error in 2^-16 as change in 2^-12, that is 0.025.
constexpr int kRate = 13;
constexpr int kRateShift = 13;

// A bit's sign as input, or 0 where there is none.
using Signs = std::array<int16_t, kBits + 1>;

// Similarity of the image's brightness at two points that lie this far apart, in 2^-20.
int64_t Similarity(int dx, int dy) { return (12 << 20) / (12 + dx * dx + dy * dy); }

int64_t Covariance(const BriefPair& p, const BriefPair& q) {
  return Similarity(p.ax - q.ax, p.ay - q.ay) - Similarity(p.ax - q.bx, p.ay - q.by) -
         Similarity(p.bx - q.ax, p.by - q.ay) + Similarity(p.bx - q.bx, p.by - q.by);
}

// For each bit the earlier ones that tell most about it, and the weights to start with.
struct Start {
  std::array<std::array<int16_t, kEarlier>, kBits> earlier;
  std::array<std::array<int16_t, kInputs>, kBits> weights_q12;
};

struct Candidate {
  int64_t correlation_q12;
  int bit;
};

std::vector<Candidate> EarlierBits(int bit) {
  const auto& pattern = BriefPattern();
  const int64_t variance = Covariance(pattern[bit], pattern[bit]);
  std::vector<Candidate> candidates;
  for (int j = 0; j < bit; ++j) {
    const double product = static_cast<double>(variance * Covariance(pattern[j], pattern[j]));
    // The square root is exact to the last place by IEEE 754, hence the same everywhere.
    const auto norm = static_cast<int64_t>(std::sqrt(product));
    candidates.push_back({Covariance(pattern[bit], pattern[j]) * kOne_q12 / norm, j});
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    const int64_t size_a = std::abs(a.correlation_q12), size_b = std::abs(b.correlation_q12);
    return size_a != size_b ? size_a > size_b : a.bit > b.bit;
  });
  if (candidates.size() > kEarlier) candidates.resize(kEarlier);
  return candidates;
}

Start MakeStart() {
  Start start;
  for (int bit = 0; bit < kBits; ++bit) {
    start.earlier[bit].fill(kBits);  // the input that is always 0
    start.weights_q12[bit].fill(0);
    int k = 0;
    for (const Candidate& candidate : EarlierBits(bit)) {
      start.earlier[bit][k] = static_cast<int16_t>(candidate.bit);
      start.weights_q12[bit][k++] =
          static_cast<int16_t>(candidate.correlation_q12 * kCorrelationShare_q12 / kOne_q12);
    }
    start.weights_q12[bit][kEarlier] = kReferenceWeights_q12[0];
    start.weights_q12[bit][kEarlier + 1] = kReferenceWeights_q12[1];
  }
  return start;
}

const Start& TheStart() {
  static const auto* const start = new Start(MakeStart());
  return *start;
}

// 1 / (1 + exp(-x)) in 2^-16 at x = -8, -7.5 ... 8.
constexpr std::array<int, 33> kLogistic_q16 = {
    22,    36,    60,    98,    162,   267,   439,   720,   1179,  1921,  3108,
    4971,  7812,  11955, 17625, 24743, 32768, 40793, 47911, 53581, 57724, 60565,
    62428, 63615, 64357, 64816, 65097, 65269, 65374, 65438, 65476, 65500, 65514};

// x in 2^-12; linear between the table's entries.
inline uint32_t Logistic_q16(int32_t x_q12) {
  const int32_t x = std::clamp(x_q12 + 8 * kOne_q12, 0, 16 * kOne_q12 - 1);
  const int32_t step = x >> 11;
  const int32_t rest = x & 2047;
  return static_cast<uint32_t>(kLogistic_q16[step] +
                               (((kLogistic_q16[step + 1] - kLogistic_q16[step]) * rest) >> 11));
}

void SetSigns(const Descriptor* descriptor, Signs* signs) {
  for (int i = 0; i < kBits; ++i) {
    const bool one = descriptor != nullptr && ((descriptor->words[i / 64] >> (i % 64)) & 1) != 0;
    (*signs)[i] = static_cast<int16_t>(descriptor == nullptr ? 0 : (one ? 1 : -1));
  }
}

class Model {
 public:
  Model() : start_(TheStart()), weights_q12_(start_.weights_q12) {}

  // Runs through a descriptor's bits; code(i, one_q16) gives bit i.
  template <typename Code>
  Descriptor Run(const Descriptor* at_other_scale, const Descriptor* in_other_image,
                 const Code& code) {
    SetSigns(at_other_scale, &references_[0]);
    SetSigns(in_other_image, &references_[1]);
    Descriptor descriptor;
    for (int i = 0; i < kBits; ++i) {
      const bool bit = RunBit(i, code);
      signs_[i] = static_cast<int16_t>(bit ? 1 : -1);
      descriptor.words[i / 64] |= static_cast<uint64_t>(bit) << (i % 64);
    }
    return descriptor;
  }

 private:
  template <typename Code>
  bool RunBit(int i, const Code& code) {
    std::array<int16_t, kInputs> inputs;
    for (int k = 0; k < kEarlier; ++k) inputs[k] = signs_[start_.earlier[i][k]];
    inputs[kEarlier] = references_[0][i];
    inputs[kEarlier + 1] = references_[1][i];
    inputs[kEarlier + 2] = 1;
    auto& weights = weights_q12_[i];
    int32_t sum_q12 = 0;
    for (int k = 0; k < kInputs; ++k) sum_q12 += weights[k] * inputs[k];
    const uint32_t one_q16 = Logistic_q16(sum_q12);
    const bool bit = code(one_q16);
    const int32_t error_q16 = (bit ? 65535 : 0) - static_cast<int32_t>(one_q16);
    const auto step =
        static_cast<int16_t>((error_q16 * kRate + (1 << (kRateShift - 1))) >> kRateShift);
    // Weights stay within +-8 unless the bytes are made up; then they wrap round, alike everywhere.
    for (int k = 0; k < kInputs; ++k) {
      weights[k] = static_cast<int16_t>(weights[k] + step * inputs[k]);
    }
    return bit;
  }

  const Start& start_;
  std::array<std::array<int16_t, kInputs>, kBits> weights_q12_;
  Signs signs_{};
  std::array<Signs, 2> references_{};
};

const Descriptor* At(const std::vector<Descriptor>& descriptors, int index) {
  return index < 0 ? nullptr : &descriptors[static_cast<size_t>(index)];
}

}  // namespace

std::string EncodeDescriptors(const std::vector<Descriptor>& descriptors,
                              const std::vector<DescriptorReferences>& references) {
  BinaryEncoder encoder;
  const auto model = std::make_unique<Model>();
  for (size_t d = 0; d < descriptors.size(); ++d) {
    int i = 0;
    model->Run(At(descriptors, references[d][0]), At(descriptors, references[d][1]),
               [&](uint32_t one_q16) {
                 const bool bit = ((descriptors[d].words[i / 64] >> (i % 64)) & 1) != 0;
                 ++i;
                 encoder.Encode(bit, one_q16);
                 return bit;
               });
  }
  return encoder.Take();
}

StatusOr<std::vector<Descriptor>> DecodeDescriptors(
    std::string_view bytes, const std::vector<DescriptorReferences>& references) {
  BinaryDecoder decoder(bytes);
  const auto model = std::make_unique<Model>();
  std::vector<Descriptor> descriptors;
  descriptors.reserve(references.size());
  for (const DescriptorReferences& of : references) {
    descriptors.push_back(model->Run(At(descriptors, of[0]), At(descriptors, of[1]),
                                     [&](uint32_t one_q16) { return decoder.Decode(one_q16); }));
    if (decoder.PastEnd()) break;
  }
  if (descriptors.size() < references.size() || !decoder.AtEnd()) {
    return absl::InvalidArgumentError(
        absl::StrCat(bytes.size(), " bytes are not ", references.size(), " coded descriptors"));
  }
  return descriptors;
}

}  // namespace portolan
