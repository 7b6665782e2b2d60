// Descriptors in less than half of their size, without loss.
//
// The bits of a rotated-BRIEF descriptor compare points that lie close together, so that each is
// half known from those before it; and a point that was described before, at another scale or in
// an earlier keyframe, looks much the same. Each bit's probability is a logistic regression on
// those, which starts from the pattern's geometry and learns as it goes; integers throughout, so
// that every machine computes the same. proto/README.md has the definition.
#ifndef PORTOLAN_COMMON_WIRE_DESCRIPTOR_CODEC_H_
#define PORTOLAN_COMMON_WIRE_DESCRIPTOR_CODEC_H_

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/features/descriptor.h"

namespace portolan {

// Earlier descriptors in the list that one resembles, by index; -1 for none. Slot 0: the same point
// in the same image at another scale. Slot 1: the same point at the same scale in another image.
using DescriptorReferences = std::array<int, 2>;

// `references`: one for each descriptor, indices below its own.
std::string EncodeDescriptors(const std::vector<Descriptor>& descriptors,
                              const std::vector<DescriptorReferences>& references);

// As many descriptors as there are references. InvalidArgument if the bytes do not end with them.
// Takes some 8 us a descriptor whatever the bytes are: the caller limits their number.
StatusOr<std::vector<Descriptor>> DecodeDescriptors(
    std::string_view bytes, const std::vector<DescriptorReferences>& references);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_DESCRIPTOR_CODEC_H_
