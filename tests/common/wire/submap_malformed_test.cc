// Submaps that must be refused, by the encoder and by the decoder, and random damage.
#include <bit>
#include <functional>
#include <limits>
#include <random>

#include "common/wire/column_codec.h"
#include "common/wire/submap_validation.h"
#include "common/wire/submap_wire.h"
#include "google/protobuf/message.h"
#include "tests/common/wire/random_submap.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

struct ValueCase {
  std::string what;  // expected in the message
  std::function<void(Submap*)> damage;
};

TEST(EncodeSubmap, RefusesInvalidValuesAndSaysWhere) {
  const std::vector<ValueCase> cases = {
      {"agent_id", [](Submap* s) { s->key.agent = AgentId("no spaces"); }},
      {"agent_id", [](Submap* s) { s->key.agent = AgentId(std::string(65, 'a')); }},
      {"session_id", [](Submap* s) { s->key.session = SessionId(0); }},
      {"link", [](Submap* s) { s->link = LinkType::kConnected; }},
      {"link", [](Submap* s) { s->key.sequence_number = 1; }},
      {"gravity", [](Submap* s) { s->gravity_in_submap = Eigen::Vector3d(0, 0, 2); }},
      {"keyframes: 0", [](Submap* s) { s->keyframes.clear(); }},
      {"keyframes: 257", [](Submap* s) { s->keyframes.resize(257); }},
      {"keyframes[2].time", [](Submap* s) { s->keyframes[2].time = s->keyframes[1].time; }},
      {"keyframes[0].time", [](Submap* s) { s->keyframes[0].time = Timestamp(-1); }},
      {"keyframes[0].submap_from_camera",
       [](Submap* s) { s->keyframes[0].submap_from_camera.translation.x() = 0.1; }},
      {"keyframes[3].submap_from_camera: quaternion",
       [](Submap* s) { s->keyframes[3].submap_from_camera.rotation.w() = 2; }},
      {"keyframes[3].submap_from_camera: coordinate",
       [](Submap* s) { s->keyframes[3].submap_from_camera.translation.y() = kNan; }},
      {"keyframes[4].covariance", [](Submap* s) { s->keyframes[4].covariance(2, 2) = -1; }},
      {"keyframes[4].covariance", [](Submap* s) { s->keyframes[4].covariance(2, 3) = kNan; }},
      {"keyframes[1].observations[7].track",
       [](Submap* s) { s->keyframes[1].observations[7].track = TrackId(1); }},
      {"keyframes[1].observations[7].pixel",
       [](Submap* s) { s->keyframes[1].observations[7].pixel.x() = kInf; }},
      {"keyframes[1].observations[7].sigma_px",
       [](Submap* s) { s->keyframes[1].observations[7].sigma_px = 0; }},
      {"keyframes[0].features[9].pixel",
       [](Submap* s) { s->keyframes[0].features[9].pixel.y() = kNan; }},
      {"keyframes[0].features[9].half_octave",
       [](Submap* s) { s->keyframes[0].features[9].half_octave = 33; }},
      {"landmarks[5].track", [](Submap* s) { s->landmarks[5].track = s->landmarks[4].track; }},
      {"landmarks[5].point", [](Submap* s) { s->landmarks[5].point_in_submap.z() = kNan; }},
      {"landmarks[5].point", [](Submap* s) { s->landmarks[5].point_in_submap.z() = 1e30; }},
      {"landmarks[5].covariance", [](Submap* s) { s->landmarks[5].covariance.setZero(); }},
      {"frames[8].time", [](Submap* s) { s->frames[8].time = s->frames[7].time; }},
      {"frames[8].submap",
       [](Submap* s) { s->frames[8].submap_from_camera.translation[0] = kInf; }},
      {"frames", [](Submap* s) { s->frames.resize(kMaxFrames + 1); }},
  };
  for (const ValueCase& c : cases) {
    Submap submap = RandomSubmap({});
    c.damage(&submap);
    EXPECT_THAT(EncodeSubmap(submap),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.what)));
  }
}

struct MessageCase {
  std::string what;
  std::function<void(v1::Submap*)> damage;
};

TEST(DecodeSubmap, RefusesMalformedMessagesAndSaysWhere) {
  const std::vector<MessageCase> cases = {
      {"agent_id", [](v1::Submap* m) { m->clear_agent_id(); }},
      {"link", [](v1::Submap* m) { m->clear_link(); }},
      {"link", [](v1::Submap* m) { m->set_link(static_cast<v1::LinkType>(77)); }},
      {"gravity", [](v1::Submap* m) { m->add_gravity_in_submap(1); }},
      {"gravity", [](v1::Submap* m) { m->set_gravity_in_submap(0, kNan); }},
      {"observations.count", [](v1::Submap* m) { m->clear_keyframes(); }},
      {"submap_from_camera",
       [](v1::Submap* m) { m->mutable_keyframes()->mutable_submap_from_camera()->RemoveLast(); }},
      {"covariance_factor",
       [](v1::Submap* m) { m->mutable_keyframes()->set_covariance_factor(100, kNan); }},
      {"covariance_factor",
       [](v1::Submap* m) { m->mutable_keyframes()->set_covariance_factor(21, -1); }},
      {"observations.count", [](v1::Submap* m) { m->mutable_observations()->add_count(1); }},
      {"observations.count",
       [](v1::Submap* m) { m->mutable_observations()->set_count(0, 4'000'000'000u); }},
      {"observations.track", [](v1::Submap* m) { m->mutable_observations()->clear_track(); }},
      {"observations.delta_y", [](v1::Submap* m) { m->mutable_observations()->set_delta_y("x"); }},
      {"observations.sigma",
       [](v1::Submap* m) {
         m->mutable_observations()->set_sigma(EncodeColumn(std::vector<int64_t>(2400, 100)));
       }},
      {"features.y", [](v1::Submap* m) { m->mutable_features()->set_count(0, 399); }},
      {"features", [](v1::Submap* m) { m->clear_features(); }},
      {"features.coded_descriptors",
       [](v1::Submap* m) {
         auto* bytes = m->mutable_features()->mutable_coded_descriptors();
         bytes->resize(bytes->size() / 2);
       }},
      {"features.coded_descriptors",
       [](v1::Submap* m) { m->mutable_features()->mutable_coded_descriptors()->push_back('x'); }},
      {"features.coded_descriptors",
       [](v1::Submap* m) { m->mutable_features()->clear_coded_descriptors(); }},
      {"features: fields of both forms",
       [](v1::Submap* m) { m->mutable_features()->set_descriptors("x"); }},
      {"features: fields of both forms",
       [](v1::Submap* m) { m->mutable_features()->set_compact(false); }},
      {"features.observed", [](v1::Submap* m) { m->mutable_features()->clear_observed(); }},
      {"features.observed: half octave",
       [](v1::Submap* m) {
         m->mutable_features()->set_observed(EncodeColumn(std::vector<int64_t>(400, -1)));
       }},
      {"features.observed: half octave",
       [](v1::Submap* m) {
         m->mutable_features()->set_observed(
             EncodeColumn(std::vector<int64_t>(400, int64_t{1} << 33)));
       }},
      {"features.observed: more than",
       [](v1::Submap* m) {
         std::vector<int64_t> masks(400, 0);
         masks[0] = 0xff;
         m->mutable_features()->set_observed(EncodeColumn(masks));
       }},
      {"landmarks.point", [](v1::Submap* m) { m->mutable_landmarks()->add_point_in_submap(0); }},
      {"landmarks[1].track", [](v1::Submap* m) { m->mutable_landmarks()->set_track_delta(1, 0); }},
      {"landmarks.track_delta",
       [](v1::Submap* m) { m->mutable_landmarks()->set_track_delta(1, UINT32_MAX); }},
      {"landmarks.covariance_factor",
       [](v1::Submap* m) { m->mutable_landmarks()->set_covariance_factor(0, 0); }},
      {"translation_step", [](v1::Submap* m) { m->mutable_frames()->set_translation_step(kNan); }},
      {"time_origin", [](v1::Submap* m) { m->mutable_frames()->set_time_origin_ns(INT64_MAX); }},
      {"frames", [](v1::Submap* m) { m->mutable_frames()->set_count(91); }},
      {"frames[0].submap_from_camera",
       [](v1::Submap* m) {
         m->mutable_frames()->set_rotation_y(EncodeColumn(std::vector<int64_t>(90, INT64_MAX)));
       }},
      {"frames[0].time",
       [](v1::Submap* m) {
         m->mutable_frames()->set_time_ns(EncodeColumn(std::vector<int64_t>(90, INT64_MIN)));
       }},
  };
  for (const MessageCase& c : cases) {
    v1::Submap message;
    ASSERT_THAT(ToProto(RandomSubmap({}), &message), IsOk());
    c.damage(&message);
    EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.what)))
        << c.what;
  }
}

using Message = google::protobuf::Message;
using Field = google::protobuf::FieldDescriptor;

void MutateBytes(std::string* bytes, std::mt19937* random) {
  switch ((*random)() % 4) {
    case 0:
      bytes->resize(bytes->size() * ((*random)() % 100) / 100);
      break;
    case 1:
      bytes->push_back(static_cast<char>((*random)()));
      break;
    default:
      if (!bytes->empty()) (*bytes)[(*random)() % bytes->size()] = static_cast<char>((*random)());
  }
}

// Of a repeated field one entry or the length, of a bytes field some bytes.
void MutateField(const Field& field, Message* message, std::mt19937* random) {
  const auto* reflection = message->GetReflection();
  if (!field.is_repeated()) {
    if (field.type() == Field::TYPE_BYTES) {
      std::string bytes = reflection->GetString(*message, &field);
      MutateBytes(&bytes, random);
      reflection->SetString(message, &field, bytes);
    } else if (field.cpp_type() == Field::CPPTYPE_UINT32) {
      reflection->SetUInt32(message, &field, (*random)() % 100);
    } else if (field.cpp_type() == Field::CPPTYPE_BOOL) {
      reflection->SetBool(message, &field, (*random)() % 2 == 0);
    }
    return;
  }
  const int size = reflection->FieldSize(*message, &field);
  if (size == 0) return;
  const int at = static_cast<int>((*random)() % static_cast<uint32_t>(size));
  if ((*random)() % 4 == 0) return reflection->RemoveLast(message, &field);
  if (field.cpp_type() == Field::CPPTYPE_UINT32) {
    reflection->SetRepeatedUInt32(message, &field, at, (*random)() % 5000);
  } else if (field.cpp_type() == Field::CPPTYPE_INT64) {
    reflection->SetRepeatedInt64(message, &field, at, static_cast<int64_t>((*random)()));
  } else if (field.cpp_type() == Field::CPPTYPE_FLOAT) {
    reflection->SetRepeatedFloat(message, &field, at,
                                 std::bit_cast<float>(static_cast<uint32_t>((*random)())));
  }
}

void MutateSomeField(Message* message, std::mt19937* random) {
  const auto* descriptor = message->GetDescriptor();
  const Field* field = descriptor->field(
      static_cast<int>((*random)() % static_cast<uint32_t>(descriptor->field_count())));
  if (field->cpp_type() == Field::CPPTYPE_MESSAGE) {
    MutateSomeField(message->GetReflection()->MutableMessage(message, field), random);
  } else {
    MutateField(*field, message, random);
  }
}

TEST(DecodeSubmap, SurvivesEveryTruncation) {
  const auto bytes =
      EncodeSubmap(RandomSubmap({.keyframes = 4, .observations = 10, .features = 5, .frames = 12}));
  ASSERT_THAT(bytes, IsOk());
  int refused = 0;
  for (size_t size = 0; size < bytes->size(); ++size) {
    refused += DecodeSubmap(std::string_view(*bytes).substr(0, size)).ok() ? 0 : 1;
  }
  // A cut right before the optional last field gives a valid message without frames.
  EXPECT_GE(refused, static_cast<int>(bytes->size()) - 2);
}

TEST(DecodeSubmap, SurvivesRandomDamage) {
  const auto bytes =
      EncodeSubmap(RandomSubmap({.keyframes = 4, .observations = 10, .features = 5, .frames = 12}));
  ASSERT_THAT(bytes, IsOk());
  std::mt19937 random(11);
  int refused = 0;
  for (int round = 0; round < 20000; ++round) {
    std::string damaged = *bytes;
    for (int hits = 1 + static_cast<int>(random() % 4); hits > 0; --hits) {
      damaged[random() % damaged.size()] = static_cast<char>(random());
    }
    const auto decoded = DecodeSubmap(damaged);
    refused += decoded.ok() ? 0 : 1;
    if (decoded.ok()) {
      EXPECT_THAT(ValidateSubmapStructure(*decoded), IsOk());
    }
  }
  EXPECT_GT(refused, 5000);
}

// Damage within the messages, which random bytes seldom reach: each round changes, cuts or
// lengthens a few of the fields that hold columns.
TEST(DecodeSubmap, SurvivesRandomMutationsOfEveryColumn) {
  v1::Submap sound;
  ASSERT_THAT(ToProto(RandomSubmap({.keyframes = 4, .observations = 10, .features = 20}), &sound),
              IsOk());
  std::mt19937 random(13);
  int refused = 0;
  constexpr int kRounds = 4000;
  for (int round = 0; round < kRounds; ++round) {
    v1::Submap message = sound;
    for (int hits = 1 + static_cast<int>(random() % 3); hits > 0; --hits) {
      MutateSomeField(&message, &random);
    }
    const auto decoded = FromProto(message);
    if (decoded.ok()) {
      EXPECT_THAT(ValidateSubmapStructure(*decoded), IsOk());
    } else {
      ++refused;
      EXPECT_THAT(decoded, StatusIs(absl::StatusCode::kInvalidArgument));
    }
  }
  EXPECT_GT(refused, kRounds / 2);
  EXPECT_LT(refused, kRounds);
}

TEST(DecodeSubmap, SurvivesNoise) {
  std::mt19937 random(12);
  for (int round = 0; round < 2000; ++round) {
    std::string noise(random() % 300, '\0');
    for (char& c : noise) c = static_cast<char>(random());
    EXPECT_THAT(DecodeSubmap(noise), StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

TEST(DecodeSubmap, RefusesOversizedBytes) {
  EXPECT_THAT(DecodeSubmap(std::string(kMaxSubmapBytes + 1, '\0')),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("more than")));
}

}  // namespace
}  // namespace portolan
