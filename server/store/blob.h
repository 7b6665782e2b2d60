// Byte strings of fixed-width little-endian numbers, for the derived tables (layouts: README.md).
#ifndef PORTOLAN_SERVER_STORE_BLOB_H_
#define PORTOLAN_SERVER_STORE_BLOB_H_

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "common/geometry/similarity3.h"

namespace portolan {

static_assert(std::endian::native == std::endian::little, "blobs are written in host order");

class BlobWriter {
 public:
  template <typename T>
  void Write(T value) {
    static_assert(std::is_arithmetic_v<T>);
    char bytes[sizeof(T)];
    std::memcpy(bytes, &value, sizeof(T));
    bytes_.append(bytes, sizeof(T));
  }
  void WriteVector(const Eigen::Vector3d& vector);
  // Quaternion w x y z, then the translation.
  void WriteRigid(const Rigid3& rigid);
  // Scale, then as a rigid motion.
  void WriteSimilarity(const Similarity3& similarity);
  // Upper triangle, row by row.
  template <int N>
  void WriteSymmetric(const Eigen::Matrix<double, N, N>& matrix) {
    for (int row = 0; row < N; ++row) {
      for (int column = row; column < N; ++column) Write(matrix(row, column));
    }
  }

  const std::string& bytes() const { return bytes_; }
  std::string Take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

// Reading past the end gives zeros and makes ok() false; no input reaches a CHECK.
class BlobReader {
 public:
  explicit BlobReader(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  T Read() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    if (bytes_.size() < sizeof(T)) {
      ok_ = false;
      bytes_ = {};
      return value;
    }
    std::memcpy(&value, bytes_.data(), sizeof(T));
    bytes_.remove_prefix(sizeof(T));
    return value;
  }
  Eigen::Vector3d ReadVector();
  Rigid3 ReadRigid();
  Similarity3 ReadSimilarity();
  template <int N>
  Eigen::Matrix<double, N, N> ReadSymmetric() {
    Eigen::Matrix<double, N, N> matrix;
    for (int row = 0; row < N; ++row) {
      for (int column = row; column < N; ++column) {
        matrix(row, column) = matrix(column, row) = Read<double>();
      }
    }
    return matrix;
  }
  // A uint32 count of elements that take at least `min_element_size` bytes each; 0 and not ok()
  // if so many cannot follow.
  uint32_t ReadCount(size_t min_element_size);

  bool ok() const { return ok_; }
  // Everything was read and nothing is left over.
  bool AtEnd() const { return ok_ && bytes_.empty(); }

 private:
  std::string_view bytes_;
  bool ok_ = true;
};

// 64-bit FNV-1a; finds accidental damage, not malice.
uint64_t HashBytes(std::string_view bytes);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_BLOB_H_
