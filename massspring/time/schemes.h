// Schemes to step in time, by name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "massspring/time/implicit_matrix.h"

namespace testbed::massspring {

struct IntegratorOptions {
  double linear_tolerance = 1e-6;  ///< of the linearised implicit step: |b - A dv| / |b|
  Gradients gradients = {};        ///< of the linearised implicit step
  Krylov linear_solver = Krylov::Cg;
  Curvature curvature = Curvature::Projected;  ///< of the linearised implicit step
  /// Of implicit steps that minimise: forces out of balance over load, inertia and forces.
  double residual = 1e-10;
  double tolerance = 0;    ///< error of a part of a step over the body's size; 0: steps are taken whole
  double sleep_below = 0;  ///< speed (m/s) below which a body that stays so is not stepped
};

/// One scheme: positions and velocities h seconds after a state whose constrained velocities are those
/// prescribed.
class Scheme {
 public:
  virtual ~Scheme() = default;
  virtual StepReport advance(const State& state, double h, Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& v) = 0;
  /// Why its linear systems are solved as they are; empty where there are none.
  virtual std::string solver_choice() const { return {}; }
  /// What it keeps from step to step besides the state, which changes a step within its tolerance.
  virtual void archive_kept(meshing::Archive&) {}
};

using MakeScheme = std::unique_ptr<Scheme>(EquationOfMotion& motion, const IntegratorOptions& options);

/// What there is to know of a scheme before it steps. One that is neither explicit nor linearised minimises.
struct Integrator {
  std::string name;
  int order;                  ///< of the error after a given time, in the step
  bool is_explicit;           ///< has a largest stable step
  bool is_linearised;         ///< solves one linear system a step
  bool has_memory;            ///< takes the step before into account, which another length makes worthless
  bool ends_where_it_solves;  ///< else what obstacles forbid is not seen where the step ends
  MakeScheme* make;
  /// Of explicit steps in which obstacles push nodes out, which costs a scheme of more stages its order and makes
  /// energy: they are taken anew by quarter steps of this one; null: by the scheme itself.
  MakeScheme* in_touch = nullptr;
  bool minimises() const { return !is_explicit && !is_linearised; }
  /// Else the surface keeps apart from itself by a penalty.
  bool has_barriers() const { return minimises() && ends_where_it_solves; }
};

/// Every integrator there is.
const std::vector<Integrator>& integrators();

/// @throws std::runtime_error listing the known names.
const Integrator& find_integrator(const std::string& name);

/// @throws std::runtime_error for a tolerance with contacts or where steps remember the one before; for
/// obstacles where a step ends beyond where it solves.
void check_contacts(const Integrator& integrator, double tolerance, bool has_obstacles,
                    bool has_self_contact);

}  // namespace testbed::massspring
