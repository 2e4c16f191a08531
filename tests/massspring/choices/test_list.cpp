#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "massspring/choices/list.h"
#include "meshing/base/files.h"

namespace testbed::massspring {
namespace {

const std::filesystem::path kRoot = std::filesystem::path(SCENE_FOLDER).parent_path().parent_path();

/// First and last cell of a page's table, row by row, below the row that begins with `head`.
std::vector<std::pair<std::string, std::string>> table_of(const std::string& page, const std::string& head) {
  std::istringstream lines(read_file(kRoot / page));
  std::string line;
  while (std::getline(lines, line) && line.rfind("| " + head + " |", 0) != 0) {
  }
  std::getline(lines, line);  // |---|
  std::vector<std::pair<std::string, std::string>> rows;
  std::smatch cells;
  while (std::getline(lines, line) && std::regex_match(line, cells, std::regex(R"(\| (.+?) \|.* (.+) \|)")))
    rows.emplace_back(cells[1], cells[2]);
  return rows;
}

TEST(ListChoices, HasTheModelsAndIntegratorsOfThePages) {
  const auto list = list_choices();
  std::vector<std::pair<std::string, std::string>> schemes;
  for (const auto& scheme : list["schemes"])
    schemes.emplace_back("`" + scheme["name"].get<std::string>() + "`",
                         std::to_string(scheme["order"].get<int>()));
  EXPECT_EQ(table_of("massspring/README.md", "`time.integrator`"), schemes);
  const auto models = table_of("massspring/README.md", "name");
  ASSERT_EQ(models.size(), list["models"].size());
  for (size_t i = 0; i < models.size(); ++i)
    EXPECT_EQ(models[i].first, "`" + list["models"][i]["name"].get<std::string>() + "`");
}

TEST(ListChoices, HasASectionForEveryRowOfThePage) {
  std::set<std::string> listed, expected;
  const auto list = list_choices();
  for (const auto& key : list["keys"]) {
    const std::string section = key["section"];
    if (section.find('.') == std::string::npos)
      listed.insert(section.empty() ? key["key"].get<std::string>() : section);
    EXPECT_FALSE(key["key"].get<std::string>().empty());
  }
  const std::regex name("[a-z_]+");
  for (const auto& row : table_of("meshing/README.md", "section"))
    for (std::sregex_iterator word(row.first.begin(), row.first.end(), name), none; word != none; ++word)
      expected.insert(word->str());
  EXPECT_EQ(listed, expected);
}

TEST(ListChoices, GivesDefaultsAndNoneWhereThereIsNone) {
  std::map<std::string, nlohmann::ordered_json> defaults;
  const auto list = list_choices();
  for (const auto& key : list["keys"])
    defaults[key["section"].get<std::string>() + "." + key["key"].get<std::string>()] = key["default"];
  EXPECT_EQ(defaults.at("material.nu"), "0.25");
  EXPECT_EQ(defaults.at("network.calibration"), "\"node_averaged\"");
  EXPECT_TRUE(defaults.at("network.phi").is_null());
  EXPECT_TRUE(defaults.at("collapse.pivots.point").is_null());
  EXPECT_TRUE(defaults.at("obstacles.plane").is_null());
}

}  // namespace
}  // namespace testbed::massspring
