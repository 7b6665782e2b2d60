#include "server/store/blob.h"

namespace portolan {

void BlobWriter::WriteVector(const Eigen::Vector3d& vector) {
  for (int i = 0; i < 3; ++i) Write(vector[i]);
}

void BlobWriter::WriteRigid(const Rigid3& rigid) {
  Write(rigid.rotation.w());
  Write(rigid.rotation.x());
  Write(rigid.rotation.y());
  Write(rigid.rotation.z());
  WriteVector(rigid.translation);
}

void BlobWriter::WriteSimilarity(const Similarity3& similarity) {
  Write(similarity.scale);
  WriteRigid(similarity.Rigid());
}

Eigen::Vector3d BlobReader::ReadVector() {
  Eigen::Vector3d vector;
  for (int i = 0; i < 3; ++i) vector[i] = Read<double>();
  return vector;
}

Rigid3 BlobReader::ReadRigid() {
  Rigid3 rigid;
  const double w = Read<double>();
  const double x = Read<double>();
  const double y = Read<double>();
  const double z = Read<double>();
  rigid.rotation = Eigen::Quaterniond(w, x, y, z);
  rigid.translation = ReadVector();
  return rigid;
}

Similarity3 BlobReader::ReadSimilarity() {
  const double scale = Read<double>();
  return Similarity3::FromRigid(ReadRigid(), scale);
}

uint32_t BlobReader::ReadCount(size_t min_element_size) {
  const uint32_t count = Read<uint32_t>();
  if (count * static_cast<uint64_t>(min_element_size) > bytes_.size()) {
    ok_ = false;
    bytes_ = {};
    return 0;
  }
  return count;
}

uint64_t HashBytes(std::string_view bytes) {
  uint64_t hash = 0xcbf29ce484222325u;
  for (const char byte : bytes) {
    hash = (hash ^ static_cast<unsigned char>(byte)) * 0x100000001b3u;
  }
  return hash;
}

}  // namespace portolan
