#include <gtest/gtest.h>

#include "meshing/base/choices.h"

namespace testbed::meshing {

enum class Colour { Red, Green, Blue };
constexpr std::array<Named<Colour>, 3> names_of(Colour) {
  return {{{Colour::Blue, "blue"}, {Colour::Red, "red"}, {Colour::Green, "green"}}};
}

enum class Short { A, B, C };
constexpr std::array<Named<Short>, 2> names_of(Short) {
  return {{{Short::A, "a"}, {Short::B, "b"}}};
}

enum class Twice { A, B, C };
constexpr std::array<Named<Twice>, 3> names_of(Twice) {
  return {{{Twice::A, "a"}, {Twice::C, "c"}, {Twice::A, "b"}}};
}

namespace {

TEST(Choices, NamesStandInAnyOrder) {
  EXPECT_STREQ(name_of(Colour::Red), "red");
  EXPECT_STREQ(name_of(Colour::Blue), "blue");
  EXPECT_EQ(value_of<Colour>("green"), Colour::Green);
  EXPECT_EQ(value_of<Colour>("yellow"), std::nullopt);
  EXPECT_EQ(value_of<Colour>(""), std::nullopt);
  EXPECT_EQ(all_names<Colour>(), (std::vector<std::string>{"blue", "red", "green"}));
}

TEST(Choices, ATableThatLacksOrRepeatsAValueIsNotComplete) {
  EXPECT_TRUE(is_complete<Colour>());
  EXPECT_FALSE(is_complete<Short>());
  EXPECT_FALSE(is_complete<Twice>());
}

}  // namespace
}  // namespace testbed::meshing
