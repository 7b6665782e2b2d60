#include "common/base/concat.h"

#include "gtest/gtest.h"

namespace portolan {
namespace {

TEST(Concat, TakesTextNumbersViewsAndPaths) {
  const std::string text = "b";
  const std::string_view view = "cd";
  const std::filesystem::path path = "/x/y.png";
  EXPECT_EQ(Concat("a", text, view, 1, -2.5, path, 'x' == 'x'), "abcd1-2.5/x/y.png1");
}

}  // namespace
}  // namespace portolan
