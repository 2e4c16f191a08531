#include "massspring/time/schemes.h"

#include <stdexcept>

#include "meshing/base/names.h"

namespace testbed::massspring {

MakeScheme make_explicit_euler, make_symplectic_euler, make_rk4, make_implicit_euler, make_minimising_euler,
    make_midpoint, make_bdf2, make_tr_bdf2;

const std::vector<Integrator>& integrators() {
  static const std::vector<Integrator> kAll{
      {"explicit_euler", 1, true, false, false, true, make_explicit_euler},
      {"symplectic_euler", 1, true, false, false, true, make_symplectic_euler},
      {"rk4", 4, true, false, false, true, make_rk4, make_symplectic_euler},
      {"implicit_euler", 1, false, true, false, true, make_implicit_euler},
      {"minimising_euler", 1, false, false, false, true, make_minimising_euler},
      {"midpoint", 2, false, false, false, false, make_midpoint},
      {"bdf2", 2, false, false, true, true, make_bdf2},
      {"tr_bdf2", 2, false, false, false, true, make_tr_bdf2}};
  return kAll;
}

const Integrator& find_integrator(const std::string& name) {
  std::vector<std::string> known;
  for (const Integrator& integrator : integrators()) {
    if (integrator.name == name) return integrator;
    known.push_back(integrator.name);
  }
  throw std::runtime_error("time.integrator = '" + name + "': no such integrator" + suggestion(name, known));
}

void check_contacts(const Integrator& integrator, double tolerance, bool has_obstacles,
                    bool has_self_contact) {
  if (tolerance > 0 && (has_obstacles || has_self_contact || integrator.has_memory))
    throw std::runtime_error("time.tolerance = " + std::to_string(tolerance) +
                             ", expected 0 with obstacles, self_contact or bdf2");
  if (has_obstacles && !integrator.ends_where_it_solves)
    throw std::runtime_error("time.integrator = " + integrator.name +
                             " with obstacles, expected another one");
}

}  // namespace testbed::massspring
