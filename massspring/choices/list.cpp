#include "massspring/choices/list.h"

#include "massspring/calibrations/calibrate.h"
#include "massspring/time/schemes.h"

namespace testbed::massspring {

nlohmann::ordered_json list_choices() {
  nlohmann::ordered_json models, schemes, keys;
  for (const Calibration& c : calibrations())
    models.push_back({{"name", c.name},
                      {"needs_tetrahedra", c.needs_tetrahedra},
                      {"needs_links", c.needs_links},
                      {"is_coupled", c.is_coupled},
                      {"least_nu", c.least_nu},
                      {"largest_nu", c.largest_nu}});
  for (const Integrator& i : integrators())
    schemes.push_back({{"name", i.name},
                       {"order", i.order},
                       {"is_explicit", i.is_explicit},
                       {"is_linearised", i.is_linearised},
                       {"has_memory", i.has_memory},
                       {"ends_where_it_solves", i.ends_where_it_solves}});
  Scene scene;  // with one of each table
  scene.supports.emplace_back();
  scene.seams.emplace_back();
  scene.loads.emplace_back();
  scene.initial.emplace_back();
  scene.collapse.emplace().pivots.push_back({{0, 0, 0}, {}, 0, {}});
  scene.volume.emplace();
  scene.skin.emplace();
  scene.obstacles.emplace_back().shape = HalfSpace{{0, 0, 0}, {0, 0, 1}};
  scene.handles.emplace_back();
  scene.events.emplace_back();
  for (const SceneKey& key : keys_of(scene)) {
    const size_t dot = key.path.rfind('.');
    keys.push_back({{"section", dot == std::string::npos ? "" : key.path.substr(0, dot)},
                    {"key", key.path.substr(dot + 1)},
                    {"default", key.is_chosen || key.value.empty() ? nlohmann::ordered_json()
                                                                   : nlohmann::ordered_json(key.value)},
                    {"meaning", key.meaning}});
  }
  return {{"models", models}, {"schemes", schemes}, {"keys", keys}};
}

}  // namespace testbed::massspring
