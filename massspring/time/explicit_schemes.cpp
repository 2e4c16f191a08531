#include "massspring/time/schemes.h"
#include "meshing/algebra/subdomains.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

/// dv = h W f(x, v); dx = h v with the old velocity (explicit) or the new one (symplectic) [paper 3.4].
class Euler : public Scheme {
 public:
  Euler(const EquationOfMotion& motion, bool is_symplectic)
      : motion_(motion), is_symplectic_(is_symplectic), inverse_mass_(motion.model.mass.cwiseInverse()) {}

  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    motion_.undamped_forces_at(state, f_);
    motion_.add_spring_damping(state.x, state.v, f_);
    const double kept = 1 - h * motion_.forces.mass_damping;
    v.resizeLike(f_);
    x.resizeLike(f_);
    const Matrix3Xd& u = is_symplectic_ ? v : state.v;
    for_each_chunk(v.cols(), [&](Eigen::Index begin, Eigen::Index end) {
      const Eigen::Index m = end - begin;
      v.middleCols(begin, m) = kept * state.v.middleCols(begin, m) +
                               h * f_.middleCols(begin, m) * inverse_mass_.segment(begin, m).asDiagonal();
      x.middleCols(begin, m) = state.x.middleCols(begin, m) + h * u.middleCols(begin, m);
    });
    motion_.constrain(v);
    for (const Constraint& c : motion_.constraints) x.col(c.node) = state.x.col(c.node) + h * u.col(c.node);
    return {};
  }

 private:
  const EquationOfMotion& motion_;
  bool is_symplectic_;
  Eigen::VectorXd inverse_mass_;
  Matrix3Xd f_;
};

/// The classical method of order four [Kutta 1901].
class Rk4 : public Scheme {
 public:
  explicit Rk4(const EquationOfMotion& motion) : motion_(motion) {}

  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    const Matrix3Xd a1 = acceleration(state);
    const State s2 = at(state, h / 2, state.v, a1);
    const Matrix3Xd a2 = acceleration(s2);
    const State s3 = at(state, h / 2, s2.v, a2);
    const Matrix3Xd a3 = acceleration(s3);
    const State s4 = at(state, h, s3.v, a3);
    const Matrix3Xd a4 = acceleration(s4);
    x = state.x + h / 6 * (state.v + 2 * s2.v + 2 * s3.v + s4.v);
    v = state.v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
    return {};
  }

 private:
  Matrix3Xd acceleration(const State& state) const {
    Matrix3Xd a;
    motion_.forces_at(state, a);
    a = (a * motion_.model.mass.cwiseInverse().asDiagonal()).eval();
    filter(motion_.constraints, a);
    return a;
  }

  static State at(const State& state, double h, const Matrix3Xd& v, const Matrix3Xd& a) {
    State stage = state;
    stage.x += h * v;
    stage.v += h * a;
    return stage;
  }

  const EquationOfMotion& motion_;
};

}  // namespace

std::unique_ptr<Scheme> make_explicit_euler(EquationOfMotion& motion, const IntegratorOptions&) {
  return std::make_unique<Euler>(motion, false);
}
std::unique_ptr<Scheme> make_symplectic_euler(EquationOfMotion& motion, const IntegratorOptions&) {
  return std::make_unique<Euler>(motion, true);
}
std::unique_ptr<Scheme> make_rk4(EquationOfMotion& motion, const IntegratorOptions&) {
  return std::make_unique<Rk4>(motion);
}

}  // namespace testbed::massspring
